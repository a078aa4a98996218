"""Made and damaged input for every reader of untrusted input (`make fuzz`)."""
