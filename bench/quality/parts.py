"""Map the names of joints to kinds of parts, and the names of files to families of shapes."""

import re
from collections.abc import Sequence

# For `shapes.characters`: parts that every character has, with patterns for joint names. The first match counts.
MERGED = (
    ("head", r"head|neck|jaw|eye"),
    ("hand", r"hand|wrist|finger|thumb"),
    ("arm", r"arm|elbow|shoulder|clavicle"),
    ("foot", r"foot|toe|ankle|heel"),
    ("leg", r"leg|knee|thigh|shin|calf"),
    ("torso", r"root|hips|pelvis|spine|chest|torso|body"),
)
# For `shapes.rigs`: finer kinds of parts of animals and people, with patterns for joint names. The first match counts.
KINDS = (
    ("ear", r"^ear"),
    ("horn", r"horn"),
    ("wing", r"wing|feather"),
    ("tail", r"tail|^main6"),
    ("fin", r"fin([_.]|$)|flipper"),
    ("hand", r"hand|wrist|finger|thumb|index|middle|ring|pinky|palm|fist"),
    ("foot", r"foot|toe|ball|hoof|^ff|^ik(front|back)leg|leg_tip|leg_._tip"),
    ("torso", r"clavicle|collar|shoulder|pelvis|hip|spine|torso|chest|back$|body|stomach|root|rib"),
    ("torso", r"abdomen|thorax|belly|^main[2-5]"),
    ("arm", r"arm"),
    ("leg", r"leg|thigh|calf|shin|ankle|knee"),
    ("neck", r"neck"),
    ("head", r"head|mouth|jaw|chin|nose|eye|tongue|brow|face|^main1"),
)
# Families of shapes, each with words that are in the names of its files. The first match counts.
FAMILIES = (
    ("seats", "chair couch bench bed stool"),
    ("fish", "fish shark whale"),
    ("four-legged", "alpaca dog fox horse shibainu wolf spot koala quadruped stegosaurus triceratops _rat"),
    ("dinosaurs", "kaiju velociraptor parasaurolophus"),
    ("mechs", "mech cyberpunk_pack_enemy"),
    ("people", "man robot knightcharacter modular male game_pack_character punk_pack_character"),
    ("helmets", "helmet skull"),
    ("people", "knight"),
    ("insects", "wasp scorpion spider _bee"),
    ("birds", "bird duck"),
    ("snakes", "snake"),
    ("plants", "pumpkin"),
    ("lights", "light lamp lantern candle"),
    ("streets", "street_pack"),
    ("plants", "plant tree bush cactus willow hay"),
    ("vehicles", "truck plane boat ship _car_ _cart tank_pack"),
    ("cabinets", "shelf nightstand oven table chest cabinet drawer fridge counter machine"),
    ("graves", "grave coffin plaque crypt"),
    ("houses", "house_3 houses well building tower sawmill gazebo market archery _port_ farm"),
    ("vessels", "sink cauldron jar ketchup pot bottle barrel crate dumpster"),
)


def kind_of_part(joint: str, patterns: Sequence[tuple[str, str]] = KINDS) -> str | None:
    """Return the part of the first pattern that matches a joint's name in lower case; None if no pattern matches."""
    return next((part for part, pattern in patterns if re.search(pattern, joint.lower())), None)


def family_of(name: str) -> str:
    """Return the first family in `FAMILIES` with a word that `name`, of a sample or file, contains; if none, `name`."""
    return next((family for family, words in FAMILIES if any(word in name.lower() for word in words.split())), name)
