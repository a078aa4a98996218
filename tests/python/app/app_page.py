"""A page for tests: a WebSocket that follows the protocol, and the files of a session."""

import json
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx2 as httpx
from numpy.typing import NDArray
from safetensors.numpy import load
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from dfd.app.web.launch import RunningApp

ROOT = Path(__file__).parents[3]
CLIENT = ROOT / "python" / "dfd" / "app" / "client"
SCREENS = ROOT / "build" / "screens"
PATIENCE = 120.0  # seconds to wait for a message; a busy machine imports torch slowly


def unpack(message: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return the fields and the arrays of a message."""
    header = json.loads(message[8 : 8 + int.from_bytes(message[:8], "little")])
    return json.loads(header["__metadata__"]["message"]), load(message)


@dataclass
class Page:
    """One tab. `heard` lists all received messages; the arrays of binary messages are in the entry "arrays"."""

    app: RunningApp
    session: str | None = None
    kept: str = ""  # the key of the kept edit that the page showed before
    heard: list[dict[str, Any]] = field(default_factory=list)
    _count: int = 0
    _open: ExitStack = field(default_factory=ExitStack)
    _socket: ClientConnection | None = None

    def open(self) -> dict[str, Any]:
        """Connect to the previous session, if there is one, and return the message `session`."""
        self.connect()
        greeting = self.hear()
        self.session = greeting["session"]
        return greeting

    def resumes(self) -> bool:
        """Connect again, and return whether the session is the previous one."""
        before = self.session
        return bool(self.open()["session"] == before)

    def connect(self) -> None:
        """Connect, and receive no message."""
        self._open = ExitStack()
        self._socket = self._open.enter_context(
            connect(
                f"ws://127.0.0.1:{self.app.port}/ws?session={self.session or ''}&kept={self.kept}",
                origin=f"http://127.0.0.1:{self.app.port}",  # type: ignore[arg-type]
                additional_headers={"Cookie": f"{self.app.rules.cookie}={self.app.rules.token}"},
                max_size=None,
                compression=None,
                proxy=None,
            )
        )

    def close(self) -> None:
        """Disconnect."""
        self._open.close()

    def closed_with(self) -> int:
        """Return the code with which the server closes the connection."""
        with suppress(ConnectionClosed):
            while True:
                self.hear()
        assert self._socket.close_code is not None
        return self._socket.close_code

    def write(self, text: str | bytes) -> None:
        """Send `text` unchanged."""
        self._socket.send(text)

    def say(self, type: str, **fields: Any) -> int:  # noqa: A002
        """Send a request, and return its `id`."""
        self._count += 1
        self.write(json.dumps({"type": type, "id": self._count, **fields}))
        return self._count

    def ask(self, type: str, **fields: Any) -> dict[str, Any]:  # noqa: A002
        """Send a request, wait for its answer, and return the answer."""
        number = self.say(type, **fields)
        return self.until(lambda message: message["id"] == number)

    def hold(self, vertex: int, **transform: Any) -> int:
        """Add a handle at a vertex, set its transform if one is given, and return its id."""
        self.ask("add", at=vertex)
        handle: int = self.last("state")["handles"][-1]["handle"]
        if transform:
            self.ask("move", handle=handle, transform=transform, settle=True)
        return handle

    def until(self, wanted: Callable[[dict[str, Any]], bool], patience: float = PATIENCE) -> dict[str, Any]:
        """Receive messages until `wanted` accepts one, and return that message."""
        end = time.monotonic() + patience
        while True:
            message = self.hear(max(end - time.monotonic(), 0.0))
            if wanted(message):
                return message

    def hear(self, patience: float = PATIENCE) -> dict[str, Any]:
        """Receive and return the next message."""
        data = self._socket.recv(timeout=patience)
        if isinstance(data, str):
            message = json.loads(data)
        else:
            message, arrays = unpack(data)
            message["arrays"] = arrays
        self.heard.append(message)
        return message

    def alive(self) -> dict[str, Any]:
        """Wait until the shape has a field, and return that state."""
        return self.until(lambda each: each["type"] == "state" and each["field"]["status"] == "ready")

    def last(self, type: str) -> dict[str, Any]:  # noqa: A002
        """Return the newest received message of a type."""
        return next(message for message in reversed(self.heard) if message["type"] == type)

    def http(self) -> httpx.Client:
        """Return an HTTP client with the cookie of this browser."""
        return httpx.Client(
            base_url=f"http://127.0.0.1:{self.app.port}",
            headers={"Origin": f"http://127.0.0.1:{self.app.port}"},
            cookies={self.app.rules.cookie: self.app.rules.token},
            trust_env=False,
            timeout=PATIENCE,
        )

    def upload(self, files: dict[str, bytes]) -> httpx.Response:
        """Upload files to the session."""
        with self.http() as http:
            parts = [("files", (name, content)) for name, content in files.items()]
            return http.post("/upload", params={"session": self.session}, files=parts)


@dataclass(frozen=True)
class Shape:
    """A small shape with its field, on disk."""

    mesh: Path
    field: Path
    encoder: Path
    settings: dict[str, Any]  # of a distillation that takes a second
    alike: tuple[int, ...] = ()  # vertices of parts that have counterparts
