"""Pictures of a mesh, by rays: cameras around it, light, and the surface point behind every pixel."""
