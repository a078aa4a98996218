"""Batches under trouble: many made shapes, some bad on purpose, workers killed on the way, on the pool and on Ray."""
