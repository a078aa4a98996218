"""Encoders: those known by name, families of networks, and where their weights come from."""
