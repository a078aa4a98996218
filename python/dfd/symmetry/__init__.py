"""Find the mirror planes of a shape from its features and its surface."""
