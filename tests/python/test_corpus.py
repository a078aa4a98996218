"""Read every input in tests/corpus as `make fuzz` reads it. Most of these inputs once failed."""

import shutil
from pathlib import Path

import pytest

from tests.fuzz.targets import TARGETS, run

CORPUS = Path(__file__).parents[1] / "corpus"
CHECKS = {name.split(".")[0] + Path(name).suffix: check for name, (_, check) in TARGETS.items()}


@pytest.mark.parametrize("kept", sorted(CORPUS.iterdir()), ids=lambda path: path.name)
def test_what_once_failed_holds(kept, tmp_path):
    path = tmp_path / f"input{kept.suffix}"
    shutil.copy(kept, path)
    run(CHECKS[kept.name.split("-")[0] + kept.suffix], path)


@pytest.mark.parametrize("kept", ["edit-surrogate.json", "edit-far.json", "edit-locality.json", "mesh-cut-off.off"])
def test_these_are_refused(kept):
    check = CHECKS[kept.split("-")[0] + Path(kept).suffix]
    with pytest.raises(ValueError, match=r"document|position|locality|faces|cut|lines|load") as refusal:
        check(CORPUS / kept)
    assert "\n" not in str(refusal.value)


def test_a_broken_promise_fails(tmp_path):
    def two_lines(_):
        raise ValueError("one\ntwo")

    def surprised(_):
        raise KeyError("x")

    with pytest.raises(AssertionError, match="no message for people"):
        run(two_lines, tmp_path)
    with pytest.raises(KeyError):
        run(surprised, tmp_path)
