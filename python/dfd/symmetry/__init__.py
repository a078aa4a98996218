"""Find the mirror planes of a shape, by its features and its surface."""
