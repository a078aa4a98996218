"""Reproduce the figures and tables of the paper on available meshes: each has one command, which writes a page."""
