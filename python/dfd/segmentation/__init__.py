"""Divide a shape into parts whose borders follow creases and changes of the features."""
