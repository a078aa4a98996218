"""Meshes and their materials, read from and written to files."""
