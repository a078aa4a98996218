"""Made and damaged input for everything that reads what a stranger may have written (`make fuzz`)."""
