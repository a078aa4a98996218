"""`python -m bench.quality labelled`, `grip` and `anatomy`, see the modules `labelled` and `anatomy`."""

import sys

from bench.quality import anatomy, labelled

if __name__ == "__main__":
    (anatomy if sys.argv[1:2] == ["anatomy"] else labelled).main()
