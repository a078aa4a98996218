"""Rigs and morph targets in USD."""
