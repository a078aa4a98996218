"""Measure surfaces: topology, distances along the surface and axes of parts; make coarser and finer copies."""
