"""OBJ files: reading, writing, and rewriting of only moved vertices."""
