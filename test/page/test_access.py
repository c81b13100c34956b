"""Who may use the page: each way in, with each thing that can be wrong."""

import asyncio
import socket
from typing import Any

import pytest

from head_tracking.page.access import Access, reached_at

LOCAL = "127.0.0.1:8080"


async def _app(scope: Any, receive: Any, send: Any) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"in"})


def _answers(access: Access, kind: str = "http", query: str = "", **headers: str) -> list[Any]:
    sent: list[Any] = []

    async def send(message: Any) -> None:
        sent.append(message)

    scope = {
        "type": kind,
        "headers": [(name.encode(), value.encode()) for name, value in headers.items()],
        "query_string": query.encode(),
    }
    asyncio.run(access(scope, None, send))
    return sent


@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize(
    ("host", "origin", "is_allowed"),
    [
        *((host, "", True) for host in (LOCAL, "localhost:8080", "[::1]:8080")),
        *((host, "", False) for host in ("127.0.0.1.evil.example", "", "[::1")),
        (LOCAL, f"http://{LOCAL}", True),
        *((LOCAL, origin, False) for origin in ("null", "http://127.0.0.1:8081", "http://[::1")),
    ],
)
def test_on_loopback_only_names_of_loopback_and_own_pages_are_allowed(
    kind, host, origin, is_allowed
):
    headers = {"host": host} | ({"origin": origin} if origin else {})
    first = _answers(Access(_app, "127.0.0.1"), kind, **headers)[0]
    assert first.get("status", 403) == (200 if is_allowed else 403)


@pytest.mark.parametrize("query", ["", "token=wrong", "token=t%C3%B6ken"])
def test_beyond_loopback_a_token_is_needed(query):
    assert _answers(Access(_app, "0.0.0.0", "right"), query=query, host="r:1")[0]["status"] == 403


def test_the_token_opens_and_its_cookie_does_afterwards():
    access = Access(_app, "0.0.0.0", "right")
    first = _answers(access, query="token=right", host="robot:8080")[0]
    cookie = dict(first["headers"])[b"set-cookie"].decode().partition(";")[0]
    assert first["status"] == 200
    assert _answers(access, host="robot:8080", cookie=cookie)[0]["status"] == 200


def test_an_answer_to_a_request_from_before_a_token_does_not_hand_it_out():
    async def app(*arguments: Any) -> None:
        access.token = "new"
        await _app(*arguments)

    access = Access(app, "127.0.0.1")
    assert b"set-cookie" not in dict(_answers(access, host=LOCAL)[0]["headers"])


def test_no_site_may_frame_an_answer_and_no_browser_shows_an_older_one():
    for access in (Access(_app, "127.0.0.1"), Access(_app, "0.0.0.0", "right")):
        headers = dict(_answers(access, host="127.0.0.1:1")[0]["headers"])
        assert headers[b"content-security-policy"] == b"frame-ancestors 'none'"
        assert headers[b"cache-control"] == b"no-cache"


@pytest.mark.parametrize(
    ("host", "name"),
    [
        *(("127.0.0.1", "localhost"), ("::1", "[::1]"), ("192.168.0.7", "192.168.0.7")),
        *(("0.0.0.0", "127.0.0.9"), ("::", "127.0.0.9")),
    ],
)
def test_the_logged_address_can_be_opened_on_another_machine(monkeypatch, host, name):
    network = ("127.0.0.9", 0)
    monkeypatch.setattr(socket.socket, "connect", lambda probe, _: probe.bind(network))
    assert reached_at(host) == name
