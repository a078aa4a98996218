"""Argument checks, threads, file writes and progress bars for all other packages of `dfd`, none of which it imports."""
