"""Ray-cast pictures of a mesh: cameras around it, light, and the surface point of every pixel."""
