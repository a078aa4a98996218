"""The one thread on which a session works: what the page says, the server orders and the background found."""

from __future__ import annotations

import json
import queue
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from dfd.app.protocol import client_message
from dfd.app.session import requests

if TYPE_CHECKING:
    from dfd.app.session.session import Session

__all__ = ["Loop"]

# Only the newest of these is worth an answer: the pointer, or the shape, has moved on.
OVERTAKEN = ("probe", "compute")
REST = 0.5  # seconds without a word, after which there is time to save
PAUSE = 0.05  # seconds without a word, after which there is time for instances

Work = Callable[["Session"], None]


class Loop:
    """An inbox. `page`, `order` and `post` may be called from any thread, `run` works on the caller's."""

    def __init__(self) -> None:
        self._inbox: queue.Queue[Work | None] = queue.Queue()
        self._newest: dict[str, int] = {}

    def page(self, text: str) -> None:
        """Take a message of the page."""
        try:
            message = client_message(text)
        except ValidationError as error:
            number, sentence = _number_in(text), _sentence(error)
            self._inbox.put(lambda session: session.fail(number, sentence))
            return
        if message.type in OVERTAKEN:
            self._newest[message.type] = message.id
        self._inbox.put(lambda session: self._answer(session, message))

    def order(self, work: Work) -> None:
        """Take an order of the server."""
        self._inbox.put(work)

    def post(self, call: Callable[[], None]) -> None:
        """Take a call that has to happen on the session's thread."""
        self._inbox.put(lambda session: call())

    def end(self) -> None:
        """Let `run` return when it has done what came before."""
        self._inbox.put(None)

    def run(self, session: Session) -> None:
        """Do one thing after the other, until `end`."""
        while True:
            try:
                work = self._inbox.get(timeout=PAUSE if session.owes else REST)
            except queue.Empty:
                session.guarded(0, session.pay if session.owes else session.rest)
                continue
            if work is None:
                session.guarded(0, session.end)
                return
            work(session)

    def _answer(self, session: Session, message: Any) -> None:
        if message.type in OVERTAKEN and message.id != self._newest[message.type]:
            return
        requests.receive(session, message)


def _number_in(text: str) -> int:
    """The `id` of a message that is none, as far as it can be told."""
    try:
        number = json.loads(text)["id"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return 0
    return number if isinstance(number, int) and 0 < number <= 2**53 else 0


def _sentence(error: ValidationError) -> str:
    first = error.errors(include_url=False, include_input=False, include_context=False)[0]
    where = ".".join(str(step) for step in first["loc"])
    reason = re.sub(r"\s+", " ", str(first["msg"]))[:200]
    return f"The message was not understood: {f'`{where}`: ' if where else ''}{reason}"
