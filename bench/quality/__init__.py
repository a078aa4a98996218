"""Are the weights good? Numbers and pictures from labelled shapes, beside methods that know no features.

`python -m bench.quality` from the repository's root writes bench/results/quality; `--help` says the rest.
"""
