"""Pictures for people: ray-cast shapes, colours that stand for numbers, sheets."""
