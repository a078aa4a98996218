"""Encoders: presets, families of networks, and where their weights come from."""
