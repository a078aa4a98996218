"""Reproduce each figure and table of the paper by one command, on available meshes.

For each figure, one function makes a page. Its argument, a `subjects.Context`, loads meshes and makes fields.
"""
