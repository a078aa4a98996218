"""Test that the guard accepts requests only from the page of this server, over HTTP and WebSocket."""

import pytest
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.testclient import TestClient
from starlette.websockets import WebSocket, WebSocketDisconnect

from dfd.app.web.safety import NOT_ALLOWED, Guard, Rules, check_host_name, check_root_path

HOST = "127.0.0.1:8765"
ORIGIN = f"http://{HOST}"


async def secret(request: Request) -> Response:
    return PlainTextResponse("secret")


async def echo(socket: WebSocket) -> None:
    await socket.accept()
    await socket.send_text("secret")
    await socket.close()


def client(rules: Rules | None = None, *, known: bool = True, host: str = HOST) -> TestClient:
    rules = rules or Rules(token="the-token")
    app = Starlette(
        routes=[Route("/", secret, methods=["GET", "POST"]), WebSocketRoute("/ws", echo)],
        middleware=[Middleware(Guard, rules=rules)],
    )
    cookies = {rules.cookie: rules.token} if known else {}
    return TestClient(app, base_url=f"http://{host}", cookies=cookies, follow_redirects=False)


def refused(browser: TestClient, path: str, headers: dict[str, str]) -> None:
    with pytest.raises(WebSocketDisconnect) as closed, browser.websocket_connect(path, headers=headers) as socket:
        socket.receive_text()
    assert closed.value.code == NOT_ALLOWED


def test_the_address_with_the_token_gives_a_cookie_and_goes_on_without_it() -> None:
    browser = client(known=False)
    response = browser.get("/?token=the-token&look=clay")
    assert response.status_code == 303
    assert response.headers["location"] == "/?look=clay"
    cookie = response.headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    assert browser.get("/").text == "secret"


@pytest.mark.parametrize("path", ["//evil.example/", "///evil.example", "/\\\\evil.example", "//"])
def test_the_address_with_the_token_leads_to_no_other_server(path: str) -> None:
    scope_path = client(known=False).get(f"http://{HOST}{path}?token=the-token").headers["location"]
    assert scope_path.startswith("/")
    assert scope_path[1:2] not in ("/", "\\")


@pytest.mark.parametrize("query", ["", "?token=", "?token=another", "?token=the-token2", "?token=th%C3%A9"])
def test_without_the_token_there_is_nothing(query: str) -> None:
    browser = client(known=False)
    browser.cookies.set("dfd", "another")
    response = browser.get(f"/{query}")
    assert response.status_code == 403
    assert "secret" not in response.text
    assert "set-cookie" not in response.headers


def test_cookies_of_other_programs_do_not_matter() -> None:
    odd = 'a={"b": [1]}; =; x@y=\xe9"; dfd2=the-token; ;;'
    for known, status in (("; dfd=the-token", 200), ("", 403)):
        response = client(known=False).get("/", headers={"Cookie": f"{odd}{known}".encode("latin-1")})  # type: ignore[dict-item]
        assert response.status_code == status


def test_only_a_get_takes_the_token() -> None:
    assert client(known=False).post("/?token=the-token", headers={"Origin": ORIGIN}).status_code == 403
    refused(client(known=False), "/ws?token=the-token", {"Host": HOST, "Origin": ORIGIN})


def test_who_followed_a_link_takes_one_more_step() -> None:
    """Browsers omit a strict cookie from a redirect that began on another site."""
    headers = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate"}
    response = client(known=False).get("/", headers=headers)
    assert response.headers["refresh"] == "0; url=/"
    assert response.text == ""


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8765", "127.0.0.1.evil.example:8765", "10.0.0.1:8765", ""]
)
def test_another_host_is_refused(host: str) -> None:
    assert client().get("/", headers={"Host": host}).status_code == 421
    refused(client(), "/ws", {"Host": host, "Origin": f"http://{host}"})


@pytest.mark.parametrize("host", [HOST, "localhost:8765", "LOCALHOST:9000", "[::1]:8765", "127.0.0.1"])
def test_names_of_this_machine_are_known(host: str) -> None:
    assert client(host=host).get("/").text == "secret"


@pytest.mark.parametrize(
    "origin",
    ["null", "http://evil.example", "https://127.0.0.1:8765", "http://127.0.0.1:1", "http://localhost:8765", "", None],
)
def test_a_page_of_another_origin_is_refused(origin: str | None) -> None:
    headers = {} if origin is None else {"Origin": origin}
    assert client().post("/", headers=headers).status_code == 403
    refused(client(), "/ws", {"Host": HOST, **headers})
    if origin is not None:
        assert client().get("/", headers=headers).status_code == 403


def test_its_own_page_gets_through_and_a_websocket_needs_the_cookie() -> None:
    assert client().post("/", headers={"Origin": ORIGIN}).text == "secret"
    with client().websocket_connect("/ws", headers={"Host": HOST, "Origin": ORIGIN}) as socket:
        assert socket.receive_text() == "secret"
    refused(client(known=False), "/ws", {"Host": HOST, "Origin": ORIGIN})


@pytest.mark.parametrize("known", [True, False])
def test_every_answer_holds_the_page_to_itself(known: bool) -> None:
    headers = client(known=known).get("/").headers
    policy = dict(part.split(" ", 1) for part in headers["content-security-policy"].split("; "))
    assert policy["default-src"] == "'none'"
    assert policy["script-src"] == policy["style-src"] == policy["connect-src"] == "'self'"
    assert policy["frame-ancestors"] == "'none'"
    assert "unsafe" not in headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["x-frame-options"] == "DENY"
    assert headers["cross-origin-resource-policy"] == "same-origin"
    assert headers["cache-control"] == "no-store"


def test_a_server_for_other_machines_goes_by_numbers_and_not_by_any_name() -> None:
    rules = Rules(host="0.0.0.0")
    assert rules.is_own_host("192.168.3.4")
    assert rules.is_own_host("localhost")
    assert not rules.is_own_host("evil.example")
    assert not Rules(host="127.0.0.1").is_own_host("192.168.3.4")
    assert Rules(host="workstation.lab").is_own_host("workstation.lab")


# Behind a proxy

PROXIED = Rules(token="the-token", allowed_hosts=("hub.example.org",), root_path="/user/me")


@pytest.mark.parametrize("host", ["hub.example.org", "HUB.example.org:443", HOST])
@pytest.mark.parametrize(
    "origin", ["https://hub.example.org", "http://hub.example.org:8080", "https://hub.example.org:443"]
)
@pytest.mark.parametrize("root", ["", "/user/me"])
def test_an_allowed_host_gets_through_a_proxy(host: str, origin: str, root: str) -> None:
    """The proxy may pass on its own host name or that of the server, and may remove the path or not."""
    headers = {"Host": host, "Origin": origin}
    assert client(PROXIED).post(f"{root}/", headers=headers).text == "secret"
    with client(PROXIED).websocket_connect(f"{root}/ws", headers=headers) as socket:
        assert socket.receive_text() == "secret"


@pytest.mark.parametrize(
    "origin",
    [
        *("https://evil.example", "https://hub.example.org.evil.example", "https://evil.example/hub.example.org"),
        *("https://hub.example.org@evil.example", "ftp://hub.example.org", "null", "hub.example.org", "https://"),
        *("https://sub.hub.example.org", "https://[hub.example.org]@evil.example", "https://[hub.example.org]/evil"),
    ],
)
def test_all_other_origins_stay_refused_behind_a_proxy(origin: str) -> None:
    for host in (HOST, "hub.example.org"):
        headers = {"Host": host, "Origin": origin}
        assert client(PROXIED).post("/", headers=headers).status_code == 403
        refused(client(PROXIED), "/ws", headers)


@pytest.mark.parametrize("host", ["evil.example", "sub.hub.example.org", "10.0.0.1:8765"])
def test_all_other_hosts_stay_refused_behind_a_proxy(host: str) -> None:
    assert client(PROXIED).get("/", headers={"Host": host}).status_code == 421


@pytest.mark.parametrize("root", ["", "/user/me"])
def test_the_token_guards_behind_a_proxy(root: str) -> None:
    browser = client(PROXIED, known=False)
    assert browser.get(f"{root}/", headers={"Host": "hub.example.org"}).status_code == 403
    response = browser.get(f"{root}/?token=the-token&look=clay", headers={"Host": "hub.example.org"})
    assert response.headers["location"] == "/user/me/?look=clay"
    assert "path=/user/me/" in response.headers["set-cookie"].lower()
    headers = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate", "Host": "hub.example.org"}
    assert client(PROXIED, known=False).get(f"{root}/", headers=headers).headers["refresh"] == "0; url=/user/me/"


def test_a_cookie_of_a_page_with_tls_is_secure() -> None:
    browser = client(PROXIED, known=False)
    browser.base_url = "https://hub.example.org"  # type: ignore[assignment]
    assert "secure" in browser.get("/?token=the-token").headers["set-cookie"].lower()


@pytest.mark.parametrize("path", ["/user/meme/", "/user/you/", "/user/me/user/me/"])
def test_another_path_is_not_the_root(path: str) -> None:
    assert client(PROXIED).get(path).status_code == 404


@pytest.mark.parametrize(
    "name", ["*", "*.example.org", "https://hub", "hub:80", "hub/p", "", "a b", "-a", "hub.", "a..b"]
)
def test_names_that_are_no_host_names(name: str) -> None:
    with pytest.raises(ValueError, match="must be a host name"):
        check_host_name(name)


@pytest.mark.parametrize("path", ["p", "/p q", "//evil", "/a/../b", "/a?b", "https://a/b", "/./a"])
def test_paths_that_are_no_root(path: str) -> None:
    with pytest.raises(ValueError, match="must be a path"):
        check_root_path(path)


def test_names_and_paths_are_normalized() -> None:
    assert check_host_name("Hub.Example.ORG") == "hub.example.org"
    assert check_host_name("10.1.2.3") == "10.1.2.3"
    assert [check_root_path(each) for each in ("", "/", "/p/", "/user/me.x/proxy/8765")] == [
        "", "", "/p", "/user/me.x/proxy/8765"]  # fmt: skip
