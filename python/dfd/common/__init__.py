"""Argument checks, threads, files and progress bars for all other packages; this package imports none of them."""
