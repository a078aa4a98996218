"""The app: one shape in a browser tab. The server computes weights, the page draws; see `dfd.app.protocol`."""

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
