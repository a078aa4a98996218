"""Many shapes: one edit carried to all of them, and every step from file to table over whole collections."""
