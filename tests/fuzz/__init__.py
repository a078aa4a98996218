"""Generate and damage input for every function that reads untrusted input (`make fuzz`)."""
