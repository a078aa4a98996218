"""Argument checks, threads, file writes and progress bars for all other packages of `dfd`, which it does not import."""
