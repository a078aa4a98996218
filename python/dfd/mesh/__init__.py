"""A mesh and its materials, from a file and back into one."""
