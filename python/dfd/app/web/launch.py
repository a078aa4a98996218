"""Run the app's server. Its address contains a secret token. When the server ends, it deletes the sessions' files."""

import html
import signal
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import uvicorn

from dfd.app.options import SessionOptions
from dfd.app.web.access_token import kept_token, new_token
from dfd.app.web.safety import Rules, check_host_name, check_root_path, loopback
from dfd.app.web.server import MESSAGE_BYTES, STATIC, UPLOAD_BYTES, Sessions, create
from dfd.app.web.temporary_folder import TemporaryFolder

DEFAULT_PORT = 8765


class RunningApp:
    """A server of the app. `start` runs it on a new thread, `run` on the current thread. Port 0 selects any free port.

    Web pages from the origins `frame_ancestors`, such as "http://localhost:*", may show the app in a frame. A proxy may
    show it under the host names `allowed_hosts`, at the path `root_path`.

    Raises ValueError if a host name or the path is malformed. Raises OSError if the port is taken, or the host is not
    an address of this machine.
    """

    def __init__(
        self,
        options: SessionOptions,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        frame_ancestors: tuple[str, ...] = (),
        allowed_hosts: Sequence[str] = (),
        root_path: str = "",
        upload_bytes: int = UPLOAD_BYTES,
        static: Path = STATIC,
    ) -> None:
        hosts, root = tuple(map(check_host_name, allowed_hosts)), check_root_path(root_path)
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        try:
            self._socket = socket.create_server((host, port), family=family, backlog=128)
        except OSError as error:
            reason = (error.strerror or "").partition(" (while")[0]  # the text after it repeats the address
            raise OSError(error.errno, f"cannot listen at {host}:{port}: {reason}") from None
        self.port = int(self._socket.getsockname()[1])
        token = kept_token() if loopback(host) and not frame_ancestors and not hosts else new_token()
        self.rules = Rules(host, token, f"dfd-{self.port}", frame_ancestors, hosts, root)
        name = socket.gethostname() if host in ("0.0.0.0", "::") else f"[{host}]" if ":" in host else host
        self.url = f"http://{name}:{self.port}{root}/?token={self.rules.token}"
        self.proxied = [f"https://{each}{root}/?token={self.rules.token}" for each in hosts]  # if the proxy has TLS
        self._root = TemporaryFolder()
        self.sessions = Sessions(self._root.path, options, upload_bytes)
        config = uvicorn.Config(
            create(self.sessions, self.rules, static=static),
            ws="websockets-sansio",
            ws_max_size=MESSAGE_BYTES,
            ws_per_message_deflate=False,  # compressing a mesh would block the event loop for seconds
            log_level="warning",
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=5,
        )
        self.server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self.run, name="dfd-app", daemon=True)

    def redirecting_file(self) -> Path:
        """Write a page that redirects to `url`, and that only this user can read. Return its path.

        All users of the machine can see the command that opens the browser, so the token must not be in this command.
        """
        path = self._root.path / "open.html"
        path.touch(0o600, exist_ok=False)
        path.write_text(f'<!doctype html><meta http-equiv="refresh" content="0; url={html.escape(self.url)}">')
        return path

    def run(self) -> None:
        """Serve until `stop` or a signal ends the server, then delete the files of all sessions."""
        if threading.current_thread() is threading.main_thread():
            # After its shutdown, uvicorn raises the signal again. The default action would skip the cleanup below.
            signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
        try:
            self.server.run(sockets=[self._socket])
        finally:
            self._socket.close()
            self.sessions.join()
            self._root.cleanup()

    def start(self) -> None:
        """Serve on a new thread. Return when the server accepts requests."""
        self._thread.start()
        while not self.server.started and self._thread.is_alive():
            self._thread.join(0.01)

    def stop(self) -> None:
        """End all sessions and the server."""
        self.server.should_exit = True
        self._thread.join()


def check_built(static: Path = STATIC) -> None:
    """Raise FileNotFoundError if the page was not built; the message says how to build it."""
    if not (static / "index.html").is_file():
        raise FileNotFoundError(
            "the page is not built: install Node (20 or newer) and then dfd again from its sources, "
            "or install a released wheel"
        )


def serve(
    options: SessionOptions,
    *,
    host: str,
    port: int | None,
    browser: bool,
    tell: Callable[[str], None],
    allowed_hosts: Sequence[str] = (),
    root_path: str = "",
) -> None:
    """Run the app until it is interrupted. `tell` is called with the address of the page, and those behind a proxy.

    If `port` is None, the app uses the default port, or any free port if the default port is taken.

    Raises OSError if the page has not been built, the port is taken, or `host` is not an address of this machine.
    """
    check_built()
    start = partial(RunningApp, options, host=host, allowed_hosts=allowed_hosts, root_path=root_path)
    try:
        app = start(port=DEFAULT_PORT if port is None else port)
    except OSError:
        if port is not None:
            raise
        app = start()
    for url in (app.url, *app.proxied):
        tell(url)
    timer = threading.Timer(0.5, lambda: webbrowser.open(app.redirecting_file().as_uri()))
    timer.daemon = True
    if browser and loopback(host):
        timer.start()
    try:
        app.run()
    finally:
        timer.cancel()


class Frame:
    """The page in a notebook cell, `height` pixels high. Another browser tab can show the page at `url`."""

    def __init__(self, app: RunningApp, height: int) -> None:
        self.app, self.url, self._height = app, app.url, height

    def __repr__(self) -> str:
        """Return the address, for programs that do not show HTML."""
        return f"Frame({self.url})"

    def _repr_html_(self) -> str:
        # Browsers treat localhost and 127.0.0.1 as two sites, and send no cookies to a frame of another site. So the
        # frame must use the host name of the notebook.
        address, name = html.escape(self.url), f"dfd-{self.app.port}"
        return (
            f'<iframe id="{name}" src="{address}" width="100%" height="{self._height}" style="border:0"></iframe>'
            f'<script>{{const frame = document.getElementById("{name}"), host = location.hostname;'
            'if (host === "localhost") frame.src = frame.src.replace("127.0.0.1", host);}</script>'
            f'<a href="{address}" target="_blank">Open in a tab</a>'
        )
