"""How much each vertex follows each handle."""
