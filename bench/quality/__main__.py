"""`python -m bench.quality labelled` and `grip`, see `bench.quality.labelled`."""

from bench.quality.labelled import main

if __name__ == "__main__":
    main()
