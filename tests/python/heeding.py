"""Code that runs the command `dfd` in a process that can be interrupted by SIGINT."""

__all__ = ["HEED"]

# Child processes inherit an ignored SIGINT, for example from `nohup`. This code restores Python's handler first.
HEED = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from dfd.cli import main; main()"
