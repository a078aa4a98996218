"""`python -m dfd` is the command line."""

from dfd.cli import main

if __name__ == "__main__":
    main()
