"""glTF and GLB files: reading, and rewriting of vertex positions with everything else unchanged."""
