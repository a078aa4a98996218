"""`dfd` as a process that heeds interruptions, however the tests were started."""

__all__ = ["HEED"]

# What ignores SIGINT hands that on to its children, as `nohup` does: they begin with Python's own handler again.
HEED = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from dfd.cli import main; main()"
