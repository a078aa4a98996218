"""The app: one shape in a browser's tab. The server binds, the page draws; they talk as `dfd.app.protocol` says."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dfd.app.web.launch import Frame
    from dfd.editing.deformer import Deformer

__all__ = ["show"]


def show(deformer: Deformer, *, height: int = 640) -> Frame:
    """Show an editing session in a cell of a notebook; see `dfd.app.web.launch.show`."""
    from dfd.app.web import launch

    return launch.show(deformer, height=height)
