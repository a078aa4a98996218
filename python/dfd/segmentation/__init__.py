"""Find the parts of a shape, whose borders follow creases and changes of the features."""
