"""Move vertices by blended transforms, and along curves that bend and twist."""
