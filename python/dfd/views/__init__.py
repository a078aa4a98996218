"""Render pictures of a mesh by casting rays, and find the surface point of each pixel."""
