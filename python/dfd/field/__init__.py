"""The neural feature field, and its files."""
