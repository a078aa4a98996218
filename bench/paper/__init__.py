"""Reproduce each figure and table of the paper by one command, on available meshes.

A function makes the page of each figure. Its argument is a `subjects.Context`, which loads meshes and makes fields.
"""
