from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dfd.app.web.loop import Loop


class Debtor:
    """A session that owes something; `did` tells what it came to in which order."""

    def __init__(self, loop: Loop, owed: int) -> None:
        self.loop, self.owed, self.did = loop, owed, list[str]()

    @property
    def owes(self) -> bool:
        return self.owed > 0

    def pay(self) -> None:
        self.owed -= 1
        self.did.append("pay")
        self.loop.order(self.click)

    def click(self, session: Any) -> None:
        self.did.append("click")

    def rest(self) -> None:
        self.did.append("rest")
        self.loop.end()

    def end(self) -> None:
        self.did.append("end")

    def guarded(self, number: int, work: Callable[[], None]) -> None:
        work()


def test_whoever_clicks_waits_for_one_debt_at_most_and_saving_comes_last() -> None:
    loop = Loop()
    session: Any = Debtor(loop, owed=2)
    for _ in range(3):
        loop.order(session.click)
    loop.run(session)
    assert session.did == [*["click"] * 3, "pay", "click", "pay", "click", "rest", "end"]
