"""Evaluate, save and cache neural feature fields, and check that a field belongs to a mesh."""
