from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dfd.app.web.worker import Loop


class Stub:
    """A session with pending columns; `did` is what it did, in order."""

    def __init__(self, loop: Loop, pending: int) -> None:
        self.loop, self.pending, self.did = loop, pending, list[str]()

    @property
    def has_pending_columns(self) -> bool:
        return self.pending > 0

    def send_pending_columns(self) -> None:
        self.pending -= 1
        self.did.append("send")
        self.loop.order("click")

    def click(self) -> None:
        self.did.append("click")

    def rest(self) -> None:
        self.did.append("rest")
        self.loop.end()

    def end(self) -> None:
        self.did.append("end")

    def guarded(self, number: int, work: Callable[[], None]) -> None:
        work()


def test_a_click_waits_for_the_instances_of_one_column_at_most_and_saving_comes_last() -> None:
    loop = Loop()
    session: Any = Stub(loop, pending=2)
    for _ in range(3):
        loop.order("click")
    loop.run(session)
    assert session.did == [*["click"] * 3, "send", "click", "send", "click", "rest", "end"]
