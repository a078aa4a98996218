"""Edit one shape in a browser tab. A Python server computes weights, and the page draws. See `dfd.app.protocol`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dfd.common.distribution import needs

if TYPE_CHECKING:
    from dfd.app.web.launch import Frame, RunningApp
    from dfd.editing.deformer import Deformer

__all__ = ["show"]

NOTEBOOK_ORIGINS = ("http://localhost:*", "http://127.0.0.1:*")  # web pages that may show the app in a frame
_SHOWN: dict[int, RunningApp] = {}  # the servers that `show` has started, by `id(deformer)`


def show(deformer: Deformer, *, height: int = 640) -> Frame:
    """Show an editing session in a notebook cell, and at the address `Frame.url`. The page edits `deformer` itself.

    Do not edit the session in the page and in Python at the same time. `height` is the height of the frame in pixels.

    Raises ImportError with advice if packages of the app are missing, and OSError if the page has not been built.
    """
    try:
        from dfd.app.options import SessionOptions
        from dfd.app.web import launch
    except ImportError as error:
        raise ImportError(needs("show: the app", "app", error), name=error.name) from None

    launch.check_built()
    running = _SHOWN.get(id(deformer))
    if running is None:
        running = launch.RunningApp(SessionOptions(deformer=deformer), frame_ancestors=NOTEBOOK_ORIGINS)
        running.start()
        _SHOWN[id(deformer)] = running
    return launch.Frame(running, height)
