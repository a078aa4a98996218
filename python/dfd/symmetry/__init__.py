"""Planes across which a shape looks alike."""
