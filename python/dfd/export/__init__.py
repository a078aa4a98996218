"""Edits for other programs: rigs, morph targets, weights."""
