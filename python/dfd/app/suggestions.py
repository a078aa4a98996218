"""Places worth taking hold of, as the page lists them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from dfd.app.protocol.answers import Suggestion
from dfd.editing.suggestions import suggest_handles

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer
    from dfd.symmetry.plane import SymmetryPlane

__all__ = ["suggestions"]


def suggestions(deformer: Deformer, count: int, planes: Sequence[SymmetryPlane]) -> tuple[Suggestion, ...]:
    """At most `count` places, one for each kind of part; `planes` are those across which the shape looks alike."""
    found = []
    places = suggest_handles(deformer.mesh, deformer.features, count=count, planes=planes, finder=deformer.bound.finder)
    for index, each in enumerate(places):
        alike = f", {len(each.instances)} alike" if len(each.instances) > 1 else ""
        position: Any = tuple(float(x) for x in deformer.mesh.vertices[each.vertex])
        found.append(
            Suggestion(
                vertex=each.vertex,
                position=position,
                name=f"Part {index + 1}{alike}",
                group=index,
                share=each.share,
            )
        )
    return tuple(found)
