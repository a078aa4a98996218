"""Fuzz every reader of untrusted input with generated and damaged input (`make fuzz`)."""
