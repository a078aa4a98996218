"""Checks, threads, files and progress, for all other packages; imports none of them."""
