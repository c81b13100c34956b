"""Who may use the page: each way in, with each thing that can be wrong."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from head_tracking.page.access import Access


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
    asyncio.run(access(scope, None, send))  # type: ignore[arg-type]
    return sent


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "[::1]:8080"])
def test_loopback_needs_no_token(host: str) -> None:
    assert _answers(Access(_app, "127.0.0.1"), host=host)[0]["status"] == 200


@pytest.mark.parametrize("host", ["127.0.0.1.evil.example", "", "[::1"])
def test_another_name_for_loopback_is_refused(host: str) -> None:
    assert _answers(Access(_app, "127.0.0.1"), host=host)[0]["status"] == 403


@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize("origin", ["null", "http://127.0.0.1:8081", "http://[::1"])
def test_pages_of_others_are_refused(kind: str, origin: str) -> None:
    first = _answers(Access(_app, "127.0.0.1"), kind, host="127.0.0.1:8080", origin=origin)[0]
    assert (first["type"], first.get("status", 403)) in (
        ("websocket.close", 403),
        ("http.response.start", 403),
    )


def test_own_pages_are_allowed() -> None:
    access = Access(_app, "127.0.0.1")
    sent = _answers(access, host="127.0.0.1:8080", origin="http://127.0.0.1:8080")
    assert sent[0]["status"] == 200


@pytest.mark.parametrize("query", ["", "token=wrong", "token=t%C3%B6ken"])
def test_beyond_loopback_a_token_is_needed(query: str) -> None:
    assert _answers(Access(_app, "0.0.0.0", "right"), query=query, host="r:1")[0]["status"] == 403


def test_the_token_opens_and_its_cookie_does_afterwards() -> None:
    access = Access(_app, "0.0.0.0", "right")
    first = _answers(access, query="token=right", host="robot:8080")[0]
    cookie = dict(first["headers"])[b"set-cookie"].decode().partition(";")[0]
    assert first["status"] == 200
    assert _answers(access, host="robot:8080", cookie=cookie)[0]["status"] == 200


def test_no_site_may_frame_an_answer() -> None:
    for access in (Access(_app, "127.0.0.1"), Access(_app, "0.0.0.0", "right")):
        headers = dict(_answers(access, host="127.0.0.1:1")[0]["headers"])
        assert headers[b"content-security-policy"] == b"frame-ancestors 'none'"
