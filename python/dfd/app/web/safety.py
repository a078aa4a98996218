"""Access control: only the page opened by the user who started the server may send requests.

A page of another site can make a browser send requests here and, by DNS rebinding, even read the answers. So a request
must have a Host header that names this server, an Origin header (if any) of this server, and a cookie that is set
only at the address with the token.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket
from collections.abc import Collection
from dataclasses import dataclass, field
from urllib.parse import parse_qs, urlencode

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOOPBACK_NAMES = ("127.0.0.1", "localhost", "::1")
NOT_ALLOWED = 4403  # close code of a WebSocket

CONTENT = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; font-src 'self'; "
    "connect-src 'self'; media-src blob:; worker-src 'self'; manifest-src 'self'; base-uri 'none'; form-action 'none'; "
)


@dataclass(frozen=True)
class Rules:
    """The settings of the guard.

    Attributes
    ----------
    host
        The address that the server listens at.
    token
        The secret in the address that is opened first.
    cookie
        The cookie's name, different for each port of this machine.
    frame_ancestors
        Origins whose pages may show this one in a frame.
    """

    host: str = "127.0.0.1"
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    cookie: str = "dfd"
    frame_ancestors: Collection[str] = ()

    def knows_host(self, name: str) -> bool:
        """Whether `name` (without a port) is a host name of this server.

        If the server listens beyond this machine, that is any IP address, which unlike a name cannot be rebound by
        DNS, and the names of the machine.
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
    """Middleware that rejects requests by the rules, and adds security headers to all responses."""

    def __init__(self, app: ASGIApp, rules: Rules) -> None:
        self._app = app
        self._rules = rules

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or reject it."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        refusal = self._check_origin(scope, headers)
        if refusal is None and not self._has_cookie(headers):
            refusal = self._admit(scope, headers)
        if scope["type"] == "websocket":
            if refusal is None:
                await self._app(scope, receive, send)
            else:
                await receive()
                await send({"type": "websocket.close", "code": NOT_ALLOWED})
            return
        await (refusal or self._app)(scope, receive, self._with_headers(send))

    def _check_origin(self, scope: Scope, headers: Headers) -> Response | None:
        """The refusal of a request with another Host or Origin; None for one of this server."""
        hosts = headers.getlist("host")
        if len(hosts) != 1 or not self._rules.knows_host(_without_port(hosts[0])):
            return PlainTextResponse("This server has another host name.", 421)
        origins = headers.getlist("origin")
        needs_origin = scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD")
        if (needs_origin or origins) and origins != [f"http://{hosts[0]}"]:
            return PlainTextResponse("Requests from pages of other sites are not allowed.", 403)
        return None

    def _has_cookie(self, headers: Headers) -> bool:
        """Whether one of the cookies is ours; those of other programs on this machine may have any characters."""
        pairs = (each.partition("=") for value in headers.getlist("cookie") for each in value.split(";"))
        known = (value.strip() for name, _, value in pairs if name.strip() == self._rules.cookie)
        return any(_equal(value, self._rules.token) for value in known)

    def _admit(self, scope: Scope, headers: Headers) -> Response:
        """Set the cookie if the request has the token, else refuse it."""
        if scope["type"] == "http" and scope["method"] == "GET":
            query = parse_qs(scope["query_string"].decode("latin-1"))
            if _equal(query.pop("token", [""])[0], self._rules.token):
                rest = urlencode(query, doseq=True)
                # A path with two leading slashes would redirect to another server.
                path = "/" + scope["path"].lstrip("/\\")
                response = RedirectResponse(f"{path}{'?' if rest else ''}{rest}", 303)
                response.set_cookie(self._rules.cookie, self._rules.token, httponly=True, samesite="strict")
                return response
            if headers.get("sec-fetch-site") == "cross-site" and headers.get("sec-fetch-mode") == "navigate":
                # A link from another site omits SameSite=strict cookies; a refresh from this page sends them.
                return Response(status_code=200, headers={"Refresh": "0; url=/"})
        return PlainTextResponse("Open the address that dfd printed: it contains the token.", 403)

    def _with_headers(self, send: Send) -> Send:
        ancestors = " ".join(self._rules.frame_ancestors) or "'none'"

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers["Content-Security-Policy"] = f"{CONTENT}frame-ancestors {ancestors}"
                headers["X-Content-Type-Options"] = "nosniff"
                headers["Referrer-Policy"] = "no-referrer"
                headers["Cross-Origin-Opener-Policy"] = "same-origin"
                headers["Cross-Origin-Resource-Policy"] = "same-origin"
                headers["Permissions-Policy"] = "camera=(), microphone=(), geolocation=()"
                headers.setdefault("Cache-Control", "no-store")
                if not self._rules.frame_ancestors:
                    headers["X-Frame-Options"] = "DENY"
            await send(message)

        return send_with_headers


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
