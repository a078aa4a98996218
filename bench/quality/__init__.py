"""Judge weights by labelled shapes and rigs, beside methods without features."""
