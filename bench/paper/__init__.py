"""The paper's comparisons on the sets of handles that it used, for whoever has them.

`python -m bench.paper FOLDER` from the repository's root writes bench/results/paper; `--help` says the rest, and
`bench.paper.handles` how the sets must lie on disk.
"""
