"""Measure the quality of weights on shapes with labelled parts and on rigs (skinned GLB files)."""
