"""How fast binding and posing are, against the machine's ceilings and against other libraries."""
