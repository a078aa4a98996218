"""OBJ files: text and scene read, written, or changed where vertices moved and nowhere else."""
