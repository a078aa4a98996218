"""What every session can do: hold one edit, change it as a step, and take steps back."""

from __future__ import annotations

from collections.abc import Hashable
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from dfd.editing.door import door
from dfd.editing.edit import Edit, Fixed, Handle
from dfd.editing.history import History

if TYPE_CHECKING:
    from dfd.editing.influence.handle_weights import HandleWeights
    from dfd.editing.influence.instances import Instance
    from dfd.mesh.mesh import Mesh

__all__ = ["Steps"]


class Steps:
    """A session's edit, and the way to and from it."""

    mesh: Mesh
    _weights: HandleWeights

    def _start(self, edit: Edit) -> None:
        self._history = History(edit)
        self._next_id = 1 + max((handle.id for handle in edit.handles), default=0)

    @property
    def edit(self) -> Edit:
        """The present state, an immutable value."""
        return self._history.present

    @property
    def handles(self) -> tuple[Handle, ...]:
        """The live handles, in the order in which they came."""
        return self.edit.handles

    def handle(self, handle: int) -> Handle:
        """The handle of that id.

        Raises
        ------
        ValueError
            If there is none.
        """
        with door("Deformer.handle"):
            return self.edit.handle(handle)

    def instances(self, handle: int) -> list[tuple[Instance, bool]]:
        """The places that look like the one a handle holds, and whether each moves along (`without_instances`).

        Its own is the first, then come the others, the most alike first; `Instance.vertex` and `Instance.position` say
        where each is.

        Raises
        ------
        ValueError
            If there is no such handle.
        """
        with door("Deformer.instances"):
            return self._weights.instances(self.edit, self.edit.handle(handle))

    @property
    def fixed(self) -> tuple[Fixed, ...]:
        """The fixed points and regions, in the order in which they came."""
        return self.edit.fixed

    @property
    def can_undo(self) -> bool:
        """Whether there is a step to take back."""
        return self._history.can_undo

    @property
    def can_redo(self) -> bool:
        """Whether there is a step that was taken back."""
        return self._history.can_redo

    def undo(self) -> bool:
        """Take the newest step back; False if there is none."""
        return self._history.undo()

    def redo(self) -> bool:
        """Take a step again that was taken back; False if there is none."""
        return self._history.redo()

    def step(self) -> AbstractContextManager[None]:
        """`with deformer.step():` makes one step of all changes inside; if one of them fails, none of them happens."""
        return self._history.step()

    def _commit(self, edit: Edit) -> None:
        """Take a step that may change weights: refused where a handle could not arrive."""
        self._weights.check_arrivals(edit)
        self._weights.check_interpolation(edit)
        self._history.commit(edit)

    def _commit_move(self, edit: Edit, topic: Hashable, merge: bool) -> None:
        """Take a step that changes no weight."""
        self._history.commit(edit, topic=topic, merge=merge)
