"""glTF and GLB files: header, data, scene and materials read, and vertices moved with all else left as it was."""
