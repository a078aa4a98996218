"""Load image encoders (vision networks), find their weights, and encode pictures."""
