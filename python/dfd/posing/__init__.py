"""Move vertices by transforms."""
