"""Which shapes are of one family: what is learned from some of them is judged on the others only."""

from __future__ import annotations

__all__ = ["FAMILIES", "family_of"]

# By words in a file's name; the first one found counts.
FAMILIES = (
    ("fish", ("fish", "shark", "whale")),
    ("four-legged", ("alpaca", "dog", "fox", "horse", "shibainu", "wolf", "spot", "koala", "quadruped", "stegosaurus")),
    ("dinosaurs", ("kaiju", "velociraptor")),
    ("seats", ("chair", "couch", "bench", "bed")),
    ("people", ("man", "knight", "robot")),
    ("cabinets", ("shelf", "nightstand", "oven", "table", "chest")),
    ("lights", ("light",)),
    ("plants", ("houseplant", "tree")),
    ("vehicles", ("truck", "plane", "boat")),
    ("birds", ("bird", "duck")),
    ("insects", ("wasp", "scorpion")),
    ("snakes", ("snake",)),
    ("houses", ("house", "well")),
    ("vessels", ("sink", "cauldron")),
)


def family_of(name: str) -> str:
    """The family of a file's stem or a sample's name; of a stranger its own name."""
    return next((family for family, words in FAMILIES if any(word in name.lower() for word in words)), name)
