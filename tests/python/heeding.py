"""Code for a child process that runs `dfd` and can be interrupted by SIGINT."""

__all__ = ["HEED"]

# Restores Python's handler first, because children of a program that ignores SIGINT, such as `nohup`, also ignore it.
HEED = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from dfd.cli import main; main()"
