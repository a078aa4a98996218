"""Distillations that several studies share: each is made once, and each set of pictures is encoded once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import dfd
from dfd.common.linear_algebra import Bool, Float32, UInt8
from dfd.common.progress import Stages
from dfd.distillation.settings import LENGTHS, DistillSettings
from dfd.encoders.encode import Encoder, TokenStore, load_encoder
from dfd.encoders.known import DEFAULT_ENCODER
from dfd.field.cache_key import hash_arrays

BESIDE: dict[str, Any] = {"encoder": DEFAULT_ENCODER, "device": None, "cache": True, "texture": True}
# With whether a shape keeps its colors.
SETTINGS = DistillSettings.model_fields.keys() | BESIDE.keys()
TOKENS_KEPT = 3  # sets of pictures; the studies of one shape come one after the other


class Lab:
    """Gives fields for settings, by `dfd.distill`."""

    def __init__(self, settings: Mapping[str, Any], say: Callable[[str], None]) -> None:
        """Settings, by their names in `dfd.distill`, of all distillations; `say` hears of each."""
        self._given = dict(settings)
        self.settings = self._all(settings)
        self._say = say
        self._fields: dict[str, dfd.Field] = {}
        self._encoders: dict[tuple[str, int | None, bool], Encoder] = {}

    def field(self, shape: str, mesh: dfd.Mesh, **changes: Any) -> dfd.Field:
        """The field of `mesh`, called `shape`: the lab's settings with some `changes`.

        Besides those of `dfd.distill` there is "texture": False takes pictures in gray.

        Raises ValueError or OSError, see `dfd.distill` and `dfd.encoders.encode.load_encoder`.
        """
        replaced = LENGTHS if any(name in changes for name in LENGTHS) else ()
        settings = self._all({**{name: self._given[name] for name in self._given if name not in replaced}, **changes})
        key = f"{mesh.content_hash} {sorted(settings.items())}"
        if key not in self._fields:
            self._say(f"distilling {shape}" + "".join(f", {name} {value}" for name, value in changes.items()))
            encoder = self._encoder(settings.pop("encoder"), settings["block"], background=settings["background"])
            if not settings.pop("texture"):
                mesh = dfd.Mesh(mesh.vertices, mesh.faces)
            self._fields[key] = dfd.distill(mesh, encoder, progress=False, **settings)
        return self._fields[key]

    @staticmethod
    def _all(given: Mapping[str, Any]) -> dict[str, Any]:
        """All settings, from those that are given."""
        own = {name: value for name, value in given.items() if name not in BESIDE}
        return {**BESIDE, **given, **DistillSettings(**own).as_dict()}

    def blocks(self, encoder: str) -> tuple[int, int]:
        """The block that `encoder` uses by itself, and how many it has."""
        loaded = self._encoder(encoder, None)
        return loaded.block, loaded.depth

    def _encoder(self, name: str, block: int | None, *, background: bool = False) -> Encoder:
        key = (name, block, background)
        if key not in self._encoders:
            encoder = load_encoder(name, block=block, device=self.settings["device"], background=background)
            self._encoders[key] = remembering(encoder)
        return self._encoders[key]


def remembering(encoder: Encoder) -> Encoder:
    """Let `encoder` keep the tokens of the pictures that it saw last, for fits of other lengths and seeds."""
    kept: dict[str, Float32] = {}
    look = encoder.encode

    # With what `dfd.distill` asks for and no more: whatever else tokens depend on would belong to the key.
    def encode(
        images: UInt8, *, covered: Bool, store: TokenStore | None = None, stages: Stages | None = None
    ) -> Float32:
        key = hash_arrays(images, covered)
        if key not in kept:
            kept[key] = look(images, covered=covered, store=store, stages=stages)
            while len(kept) > TOKENS_KEPT:
                del kept[next(iter(kept))]
        return kept[key]

    encoder.encode = encode  # type: ignore[method-assign]
    return encoder
