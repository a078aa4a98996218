"""PLY, OFF and STL files: reading, writing, and rewriting of only moved vertices."""
