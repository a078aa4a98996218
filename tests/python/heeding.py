"""Code for a child process that runs `dfd` and can be interrupted by SIGINT."""

__all__ = ["HEED"]

# If the tests run under a program that ignores SIGINT, such as `nohup`, child processes also ignore it. So the code
# first restores Python's handler.
HEED = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from dfd.cli import main; main()"
