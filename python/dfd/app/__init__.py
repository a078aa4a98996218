"""The app: one shape in a browser tab. The server computes weights, the page draws; see `dfd.app.protocol`."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dfd.app.web.launch import Frame, RunningApp
    from dfd.editing.deformer import Deformer

__all__ = ["show"]

NOTEBOOK_ORIGINS = ("http://localhost:*", "http://127.0.0.1:*")
_SHOWN: dict[int, RunningApp] = {}  # servers of notebooks, by the ids of their editing sessions


def show(deformer: Deformer, *, height: int = 640) -> Frame:
    """Show an editing session in a cell of a notebook, or at the address `Frame.url`; the page edits `deformer`.

    Change the session in only one of page and notebook at a time. `height` is that of the frame, in pixels.

    Raises OSError if the page was not built.
    """
    from dfd.app.options import SessionOptions
    from dfd.app.web import launch

    launch.check_built()
    running = _SHOWN.get(id(deformer))
    if running is None:
        running = launch.RunningApp(SessionOptions(deformer=deformer), frame_ancestors=NOTEBOOK_ORIGINS)
        running.start()
        _SHOWN[id(deformer)] = running
    return launch.Frame(running, height)
