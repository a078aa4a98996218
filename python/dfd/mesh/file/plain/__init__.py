"""PLY, OFF and STL files, read by NumPy, and FBX files, read by ufbx."""
