"""Export edits to other programs: rigs, morph targets, weights and parts."""
