"""Properties of a surface: topology, coarser copies, distances along it."""
