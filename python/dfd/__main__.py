"""Run the command line by `python -m dfd`."""

from dfd.cli import main

if __name__ == "__main__":
    main()
