"""Measure surfaces (topology, distances along them, axes of parts), and make coarser and finer copies of meshes."""
