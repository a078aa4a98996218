"""Draw shapes, features and weights as pictures, and pictures on sheets."""
