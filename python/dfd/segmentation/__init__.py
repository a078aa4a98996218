"""Parts of a shape at a click: where features part, and where the surface creases."""
