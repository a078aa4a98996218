"""Which shapes are of one family: what is learned from some of them is judged on the others only."""

from __future__ import annotations

__all__ = ["FAMILIES", "family_of"]

# By words in a file's name; the first one found counts.
FAMILIES = (
    ("people", "fisherman"),
    ("fish", "fish shark whale tuna"),
    ("four-legged", "alpaca dog fox horse shibainu wolf spot koala quadruped stegosaurus cow bull pig sheep elephant"),
    (
        "four-legged",
        "bear boar bull zebu camel deer donkey giraffe goat hippo lion mastiff rabbit rhino sanga tiger zebra",
    ),
    ("four-legged", "wildebeest crocodile"),
    ("dinosaurs", "kaiju velociraptor"),
    ("seats", "chair couch bench bed"),
    ("people", "man knight robot archer axe mage guard mummy pharao prince shaman slave technician thor valk statue"),
    ("people", "behemoth daemon fakir genie ghost golem initiate intro magician anubis cudgel sphinx totem pilot"),
    ("people", "sword spear wartime general calvary tribune drake"),
    ("cabinets", "shelf nightstand oven table chest"),
    ("lights", "light"),
    ("plants", "houseplant tree palm pine cact birke baum fir cypress tanne willow mallorn papyrus farn"),
    ("vehicles", "truck plane boat ship bus dauphin f-15 locomotive tender lcm lha ferry trawler barge carrier humvee"),
    (
        "vehicles",
        "hoskosh ice3 tanker forklift sail airtrain van wagon catapult crossbow ornith aerodrome machine raft",
    ),
    ("birds", "bird duck chicken ibis phoenix dragon crow hawk seagull peacock"),
    ("insects", "wasp scorpion scarab"),
    ("snakes", "snake"),
    ("houses", "house well apartment tower farm building barn shed office temple palace tent tipi church factory"),
    ("houses", "pyramid school library smith barrack minaret obelisk techno camp med_bar silo station shop -ba pizza"),
    ("houses", "industrial foursquare lasnamae medium farm terrace toilet detached walhalla iceberg"),
    ("buoys", "buoy"),
    ("vessels", "sink cauldron"),
)


def family_of(name: str) -> str:
    """The family of a file's stem or a sample's name; of a stranger its own name."""
    return next((family for family, words in FAMILIES if any(word in name.lower() for word in words.split())), name)
