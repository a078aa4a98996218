"""The ground: checks, threads, files and progress. It imports nothing above it."""
