"""Read and write OBJ files, or rewrite only moved vertices."""
