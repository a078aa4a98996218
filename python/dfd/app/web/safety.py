"""Who may speak to the server: the page that this server gave to the person who started it, and nobody else.

A page of any other site can make a browser send requests here, and even, by giving its own name this machine's address,
read the answers. So a request must name this server as its host, must come from a page of this server where it says
where it comes from, and must carry a cookie that only the address with the token gives.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket
from collections.abc import Collection
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlencode

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

__all__ = ["Guard", "Rules", "loopback"]

LOOPBACK_NAMES = ("127.0.0.1", "localhost", "::1")
NOT_ALLOWED = 4403  # close code of a WebSocket

CONTENT = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; font-src 'self'; "
    "connect-src 'self'; media-src blob:; worker-src 'self'; manifest-src 'self'; base-uri 'none'; form-action 'none'; "
)


@dataclass(frozen=True)
class Rules:
    """What the guard goes by.

    Attributes
    ----------
    host
        The address that the server listens at.
    token
        What the first address carries.
    cookie
        Its cookie's name: servers on other ports of this machine have others.
    frames
        Origins whose pages may show this one in a frame.
    """

    host: str = "127.0.0.1"
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    cookie: str = "dfd"
    frames: Collection[str] = ()

    def knows_host(self, name: str) -> bool:
        """Whether `name` (without a port) is one that this server goes by.

        A number for an address is nobody's to give away, unlike a name: where the server listens beyond this machine,
        every number is its own, and of names the machine's alone.
        """
        name = name.lower()
        if name in LOOPBACK_NAMES or name == self.host.lower():
            return True
        if loopback(self.host):
            return False
        return _is_address(name) or name in (socket.gethostname().lower(), socket.getfqdn().lower())


def loopback(host: str) -> bool:
    """Whether only this machine reaches a server that listens at `host`."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Guard:
    """Refuses what the rules refuse, before anything else sees it, and adds the headers that hold a page to them."""

    def __init__(self, app: ASGIApp, rules: Rules) -> None:
        self._app = app
        self._rules = rules

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request through, or not."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        refusal = self._foreign(scope, headers)
        if refusal is None and not self._known(headers):
            refusal = self._enter(scope, headers)
        if scope["type"] == "websocket":
            if refusal is None:
                await self._app(scope, receive, send)
            else:
                await receive()
                await send({"type": "websocket.close", "code": NOT_ALLOWED})
            return
        await (refusal or self._app)(scope, receive, self._with_headers(send))

    def _foreign(self, scope: Scope, headers: Headers) -> Response | None:
        """The refusal of a request that names another host, or comes from a page of another origin."""
        hosts = headers.getlist("host")
        if len(hosts) != 1 or not self._rules.knows_host(_without_port(hosts[0])):
            return PlainTextResponse("This server does not go by that name.", 421)
        origins = headers.getlist("origin")
        must_say = scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD")
        if (must_say or origins) and origins != [f"http://{hosts[0]}"]:
            return PlainTextResponse("Pages of other sites may not ask this of the server.", 403)
        return None

    def _known(self, headers: Headers) -> bool:
        try:
            cookies = SimpleCookie(headers.get("cookie", ""))
        except CookieError:
            return False
        cookie = cookies.get(self._rules.cookie)
        return cookie is not None and _equal(cookie.value, self._rules.token)

    def _enter(self, scope: Scope, headers: Headers) -> Response:
        """Give the cookie to who has the token, and refuse everybody else."""
        if scope["type"] == "http" and scope["method"] == "GET":
            query = parse_qs(scope["query_string"].decode("latin-1"))
            if _equal(query.pop("token", [""])[0], self._rules.token):
                rest = urlencode(query, doseq=True)
                path = "/" + scope["path"].lstrip("/\\")  # what begins with two would name another server
                response = RedirectResponse(f"{path}{'?' if rest else ''}{rest}", 303)
                response.set_cookie(self._rules.cookie, self._rules.token, httponly=True, samesite="strict")
                return response
            if headers.get("sec-fetch-site") == "cross-site" and headers.get("sec-fetch-mode") == "navigate":
                # Who followed a link from elsewhere does not send a strict cookie; one step from here, it does.
                return Response(status_code=200, headers={"Refresh": "0; url=/"})
        return PlainTextResponse("Open the address that dfd printed: it holds the key.", 403)

    def _with_headers(self, send: Send) -> Send:
        ancestors = " ".join(self._rules.frames) or "'none'"

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers["Content-Security-Policy"] = f"{CONTENT}frame-ancestors {ancestors}"
                headers["X-Content-Type-Options"] = "nosniff"
                headers["Referrer-Policy"] = "no-referrer"
                headers["Cross-Origin-Opener-Policy"] = "same-origin"
                headers["Cross-Origin-Resource-Policy"] = "same-origin"
                headers["Permissions-Policy"] = "camera=(), microphone=(), geolocation=()"
                headers.setdefault("Cache-Control", "no-store")
                if not self._rules.frames:
                    headers["X-Frame-Options"] = "DENY"
            await send(message)

        return sending


def _equal(one: str, other: str) -> bool:
    return hmac.compare_digest(one.encode(), other.encode())


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _without_port(host: str) -> str:
    """The name in a Host header, an IPv6 address without its brackets."""
    if host.startswith("["):
        return host[1:].partition("]")[0]
    name, _, port = host.rpartition(":")
    return name if name and port.isdigit() else host
