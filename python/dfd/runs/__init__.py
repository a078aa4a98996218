"""What was computed and is found again: the cache, checkpoints and what they go by."""
