"""PLY, OFF and STL files."""
