"""Measure the quality of weights on labelled shapes and on rigs."""
