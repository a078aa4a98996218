"""OBJ files: reading, writing, and rewriting of moved vertices only."""
