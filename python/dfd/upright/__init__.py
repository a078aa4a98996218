"""Find the up direction of a shape from pictures and from its stability."""
