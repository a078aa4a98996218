"""Transforms, and the vertices that they move."""
