"""Compute how much each vertex follows each handle."""
