"""Encoders: those known by name, families of networks, and the sources of their weights."""
