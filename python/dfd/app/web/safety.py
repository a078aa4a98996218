"""Access control: only the page that the user opened may send requests.

A page of another site can make a browser send requests to this server and, by DNS rebinding, read the answers. So a
request needs a Host header that names this server, an Origin header of this server (optional for GET), and a cookie.
The server sets the cookie only if the address contains the secret token.

Behind a proxy, the names in `Rules.allowed_hosts` are also names of this server, in both headers, with any port and
with http or https. The proxy may remove the path `Rules.root_path` from addresses, or pass it on.
"""

import hmac
import ipaddress
import re
import socket
from collections.abc import Collection
from dataclasses import dataclass, field

from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from dfd.app.web.access_token import new_token

_HOST_NAME = re.compile(r"(?!-)[\w-]{1,63}(\.[\w-]{1,63})*", re.ASCII)
_ROOT_PATH = re.compile(r"(/(?!\.{1,2}(/|$))[\w.~@%+=:-]+)+", re.ASCII)
LOOPBACK_NAMES = ("127.0.0.1", "localhost", "::1")
NOT_ALLOWED = 4403  # close code of a rejected WebSocket

CONTENT_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; font-src 'self'; "
    "connect-src 'self'; media-src blob:; worker-src 'self'; manifest-src 'self'; base-uri 'none'; form-action 'none'; "
)
HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
}


@dataclass(frozen=True)
class Rules:
    """The settings of `Guard`."""

    host: str = "127.0.0.1"  # the address at which the server listens
    token: str = field(default_factory=new_token)  # the secret in the printed address
    cookie: str = "dfd"  # name of the cookie; the servers of one machine need different names
    frame_ancestors: Collection[str] = ()  # origins whose pages may show this one in a frame
    allowed_hosts: Collection[str] = ()  # further host names, in lower case, under which proxies show the page
    root_path: str = ""  # the path under which a proxy shows the page, such as "/p"; without a slash at the end

    def is_own_host(self, name: str) -> bool:
        """Return whether `name` (without a port) is a host name of this server.

        If other machines can reach the server, all IP addresses and the names of this machine are accepted. Accepting
        IP addresses is safe, because DNS rebinding needs a host name.
        """
        name = name.lower()
        if name in (*LOOPBACK_NAMES, self.host.lower(), *self.allowed_hosts):
            return True
        if loopback(self.host):
            return False
        return _address(name) is not None or name in (socket.gethostname().lower(), socket.getfqdn().lower())

    def is_own_origin(self, origin: str, host: str) -> bool:
        """Return whether pages of `origin` may send requests to this server, under the name and the port `host`."""
        scheme, _, rest = origin.partition("://")
        allowed = scheme in ("http", "https") and _without_port(rest).lower() in self.allowed_hosts
        return origin == f"http://{host}" or (allowed and "/" not in rest and "@" not in rest)

    def is_token(self, given: str | None) -> bool:
        """Return whether `given` is the token. The duration does not depend on where they differ."""
        return hmac.compare_digest((given or "").encode(), self.token.encode())


def check_host_name(name: str) -> str:
    """Return a host name in lower case; raise ValueError if it has a scheme, a port, a path or a wildcard."""
    if not _HOST_NAME.fullmatch(name) and _address(name) is None:
        raise ValueError(f"must be a host name, such as hub.example.org, got {name!r:.60}")
    return name.lower()


def check_root_path(path: str) -> str:
    """Return a path without a slash at its end; raise ValueError unless it begins with a slash and has only steps."""
    stripped = path.rstrip("/")
    if stripped and not _ROOT_PATH.fullmatch(stripped):
        raise ValueError(f"must be a path, such as /user/me/app, got {path!r:.60}")
    return stripped


def loopback(host: str) -> bool:
    """Return whether only this machine can reach a server that listens at `host`."""
    address = _address(host)
    return host.lower() == "localhost" if address is None else address.is_loopback


class Guard:
    """Middleware that rejects requests that violate the rules, and adds headers for security and caching."""

    def __init__(self, app: ASGIApp, rules: Rules) -> None:
        self._app, self._rules = app, rules
        ancestors = " ".join(rules.frame_ancestors) or "'none'"
        self._headers = {**HEADERS, "Content-Security-Policy": f"{CONTENT_POLICY}frame-ancestors {ancestors}"}
        if not rules.frame_ancestors:
            self._headers["X-Frame-Options"] = "DENY"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request to the app, or reject it."""

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.update(self._headers)
                # Browsers may keep these files: their names contain a hash of their content.
                cacheable = scope["path"].startswith("/assets/") and message["status"] in (200, 304)
                headers["Cache-Control"] = "public, max-age=31536000, immutable" if cacheable else "no-store"
            await send(message)

        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        root = self._rules.root_path
        if root and (scope["path"] == root or scope["path"].startswith(f"{root}/")):
            scope = {**scope, "path": scope["path"].removeprefix(root) or "/"}
        request = HTTPConnection(scope)
        foreign = refusal = self._check_origin(request)
        if refusal is None and not self._rules.is_token(request.cookies.get(self._rules.cookie)):
            refusal = self._admit(request)
        if scope["type"] == "http":
            await (refusal or self._app)(scope, receive, send_with_headers)
        elif refusal is None:
            await self._app(scope, receive, send)
        else:
            await receive()
            if foreign is None:
                # Browsers report a close code to the page only if the connection was accepted.
                await send({"type": "websocket.accept"})
            await send({"type": "websocket.close", "code": NOT_ALLOWED})

    def _check_origin(self, request: HTTPConnection) -> Response | None:
        """Return a refusal if the header Host or Origin names another server, or is required but missing; else None."""
        hosts, origins = request.headers.getlist("host"), request.headers.getlist("origin")
        if len(hosts) != 1 or not self._rules.is_own_host(_without_port(hosts[0])):
            return PlainTextResponse("This server has another host name.", 421)
        needs_origin = request.scope.get("method") not in ("GET", "HEAD")  # a WebSocket has no method
        one = len(origins) == 1 and self._rules.is_own_origin(origins[0], hosts[0])
        if (needs_origin or origins) and not one:
            return PlainTextResponse("Requests from pages of other sites are not allowed.", 403)
        return None

    def _admit(self, request: HTTPConnection) -> Response:
        """Return a response to a request without the cookie: set the cookie if the request has the token, or refuse."""
        if request.scope.get("method") == "GET":
            if self._rules.is_token(request.query_params.get("token")):
                rest = request.url.remove_query_params("token").query
                # A path with two leading slashes would redirect to another server.
                path = f"{self._rules.root_path}/" + request.scope["path"].lstrip("/\\")
                response = RedirectResponse(f"{path}{'?' if rest else ''}{rest}", 303)
                response.set_cookie(
                    self._rules.cookie,
                    self._rules.token,
                    path=f"{self._rules.root_path}/",
                    secure=request.url.scheme == "https",
                    httponly=True,
                    samesite="strict",
                )
                return response
            headers = request.headers
            if headers.get("sec-fetch-site") == "cross-site" and headers.get("sec-fetch-mode") == "navigate":
                # A browser that follows a link from another site omits SameSite=strict cookies. A refresh sends them.
                return Response(status_code=200, headers={"Refresh": f"0; url={self._rules.root_path}/"})
        return PlainTextResponse("Open the address that dfd printed: it contains the token.", 403)


def _address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(name)
    except ValueError:
        return None


def _without_port(host: str) -> str:
    """Return the name or the address in a Host header, without port and without the brackets of IPv6 addresses."""
    if host.startswith("["):
        return host[1:].partition("]")[0]
    name, _, port = host.rpartition(":")
    return name if name and port.isdigit() else host
