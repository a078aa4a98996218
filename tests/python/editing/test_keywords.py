"""Test the keywords of `Deformer.add`, `move` and `change`, in which mypy finds a misspelled one by their types."""

from inspect import Parameter, signature

import pytest

from dfd.editing.controls import CONTROLS
from dfd.editing.deformer import Deformer
from dfd.editing.verbs import ControlOptions, HandleOptions, MotionOptions
from dfd.posing.transforms import MOTIONS


def test_the_keywords_are_those_of_the_tables():
    assert set(MotionOptions.__annotations__) == {*MOTIONS, "matrix"}
    assert set(ControlOptions.__annotations__) == set(CONTROLS)
    assert HandleOptions.__optional_keys__ == {*MOTIONS, "matrix", *CONTROLS}


@pytest.mark.parametrize(
    ("verb", "options"), [("add", HandleOptions), ("move", MotionOptions), ("change", ControlOptions)]
)
def test_each_verb_takes_its_keywords(verb, options):
    *_, keywords = signature(getattr(Deformer, verb)).parameters.values()
    assert keywords.kind is Parameter.VAR_KEYWORD
    assert keywords.annotation == f"Unpack[{options.__name__}]"
