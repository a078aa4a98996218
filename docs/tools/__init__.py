"""What the build of the pages needs beyond Sphinx."""
