"""Make each figure and table of the paper by one command, on available meshes.

A page is a function of one argument, the `Context` of `subjects`, which has the meshes, fields and sessions.
"""
