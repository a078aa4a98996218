"""Distill a field: render pictures of a shape, encode them, smooth the features, and fit a network to them."""
