"""The shape that an edit makes of the resting one: posed whole, and from frame to frame of a drag only what moves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dfd.editing.edit import Edit, box_center
from dfd.posing.pose import Drag, pose

if TYPE_CHECKING:
    from dfd.editing.handle_weights import HandleWeights
    from dfd.mesh.mesh import Mesh

__all__ = ["PosedShape"]

IDENTITY = np.eye(3, 4)


class PosedShape:
    """The vertices of the newest edit that was asked for.

    While edits differ in the transforms of a few handles alone, all others stay folded into one base (`dfd.Drag`): a
    frame then costs what those few cost.
    """

    def __init__(self, mesh: Mesh, weights: HandleWeights) -> None:
        self._mesh = mesh
        self._weights = weights
        self._edit = Edit()
        self._vertices = mesh.vertices
        self._drag: Drag | None = None
        self._moving: list[int] = []  # which of the edit's handles `_drag` can move

    def of(self, edit: Edit) -> NDArray[np.float64]:
        """(V, 3) vertices in mesh units, read-only, moved by `edit` from where they rest."""
        if edit is not self._edit:
            vertices = self._posed(edit)
            vertices.flags.writeable = False
            self._vertices, self._edit = vertices, edit
        return self._vertices

    def _posed(self, edit: Edit) -> NDArray[np.float64]:
        moved = _moved(self._edit, edit)
        if moved == []:
            return self._vertices
        if moved is None or 2 * len(moved) > len(edit.handles):
            self._drag = None
            return self._vertices if _acting(self._edit) == _acting(edit) else self._whole(edit)
        if self._drag is None or not set(moved) <= set(self._moving):
            arguments = self._arguments(edit)
            resting = len(arguments["transforms"]) - len(edit.handles)
            self._drag = Drag(self._mesh.vertices, moving=[resting + i for i in moved], **arguments)
            self._moving = moved
        posed: NDArray[np.float64] = self._drag.pose([edit.handles[i].matrix for i in self._moving])
        return posed

    def _whole(self, edit: Edit) -> NDArray[np.float64]:
        if _acting(edit) == _acting(Edit()):
            return self._mesh.vertices  # no weight changes that
        posed: NDArray[np.float64] = pose(self._mesh.vertices, **self._arguments(edit))
        return posed

    def _arguments(self, edit: Edit) -> dict[str, Any]:
        """What `pose` and `Drag` take for `edit`."""
        weights = self._weights.blend_of(edit)
        # The handle that rests, when there is one, stands anywhere: mirrored, it rests too.
        resting = weights.shape[1] - len(edit.handles)
        places = [(0.0, 0.0, 0.0)] * resting + [handle.place.position for handle in edit.handles]
        return {
            "weights": weights,
            "transforms": np.reshape([IDENTITY] * resting + [handle.matrix for handle in edit.handles], (-1, 3, 4)),
            "default": None if edit.default is None else edit.default.matrix(box_center(self._mesh)),
            "symmetry": edit.symmetry,
            "handles": None if edit.symmetry is None else np.reshape(places, (-1, 3)),
        }


def _moved(before: Edit, after: Edit) -> list[int] | None:
    """Which handles' transforms tell two edits apart; None where other things do."""
    if len(before.handles) != len(after.handles):
        return None
    if (before.fixed, before.symmetry, before.default) != (after.fixed, after.symmetry, after.default):
        return None
    moved = []
    for i, (old, new) in enumerate(zip(before.handles, after.handles, strict=True)):
        if old is not new and (old.place, old.locality) != (new.place, new.locality):
            return None
        if old is not new and old.transform != new.transform:
            moved.append(i)
    return moved


def _acting(edit: Edit) -> tuple[Any, ...]:
    """What of an edit tells in the shape: handles that rest do not, unless they keep a D₀ from what they hold."""
    handles = [
        (handle.place, handle.locality, handle.transform)
        for handle in edit.handles
        if edit.default is not None or not handle.transform.rests
    ]
    return handles, (edit.fixed, edit.symmetry) if handles else None, edit.default
