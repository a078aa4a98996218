"""Rigs and morph targets in glTF."""
