"""Find the mirror planes across which a shape looks alike."""
