"""Make each figure and table of the paper by one command, on available meshes.

`python -m bench.paper NAME` from the repository's root writes bench/results/paper/NAME.md; `--list` names the pages. A
page is a function of one argument, the `Context` of `subjects`, which has the meshes, fields and sessions.
"""
