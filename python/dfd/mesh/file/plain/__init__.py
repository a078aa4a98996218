"""PLY, OFF and STL files, read by NumPy."""
