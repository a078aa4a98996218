"""Exports edits to other programs: rigs, morph targets, weights."""
