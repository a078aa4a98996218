"""Write rigs, morph targets and parts into glTF files."""
