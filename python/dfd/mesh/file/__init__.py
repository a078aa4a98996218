"""Mesh files: what stands in them, read with care and written back with nothing but positions changed."""
