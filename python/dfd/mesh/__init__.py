"""A mesh with its looks, from a file and back into one."""
