"""Move vertices by blended transforms, and bend and twist parts along curves."""
