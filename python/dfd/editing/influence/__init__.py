"""How much every vertex follows each handle."""
