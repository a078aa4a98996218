"""Reading mesh files, and writing them back with only positions and normals changed."""
