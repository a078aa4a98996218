"""Compute weights: how much each vertex follows each handle."""
