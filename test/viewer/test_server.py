"""Who may open a connection to the page: plain clients in the place of browsers."""

import http.client
from collections.abc import Callable, Iterator

import pytest
import viser
from websockets.asyncio import server as websocket_server
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from head_tracking.viewer.server import Door, guarded


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    door = Door("127.0.0.1")
    with guarded(door):
        server = viser.ViserServer(host="127.0.0.1", port=8180, verbose=False)
    assert door.stands, "viser starts its server in another way now"
    yield server.get_port()
    server.stop()


def open_as(port: int, origin: str | None, host: str | None = None) -> bool:
    headers = {} if host is None else {"Host": host}
    with connect(
        f"ws://127.0.0.1:{port}",
        origin=origin,
        additional_headers=headers,
        subprotocols=[f"viser-v{viser.__version__}"],
    ) as socket:
        return bool(socket.recv(timeout=10))


def test_the_pages_own_scripts_and_programs_may(port):
    assert open_as(port, f"http://127.0.0.1:{port}")
    assert open_as(port, None)


@pytest.mark.parametrize(
    "origin",
    [
        lambda port: "https://elsewhere.example",
        lambda port: f"http://elsewhere.example:{port}",
        lambda port: f"http://127.0.0.1:{port + 1}",
        lambda port: f"http://127.0.0.1:{port}.elsewhere.example",
        lambda port: "null",  # a file, or a frame in a sandbox
    ],
)
def test_other_sites_may_not(port, origin: Callable[[int], str]):
    with pytest.raises(InvalidStatus) as refused:
        open_as(port, origin(port))
    assert refused.value.response.status_code == 403
    assert b"may not steer" in refused.value.response.body


def test_a_site_whose_name_points_here_may_not_even_load_the_page(port):
    for host, status in ((f"localhost:{port}", 200), (f"elsewhere.example:{port}", 403)):
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
        connection.request("GET", "/", headers={"Host": host})
        answer = connection.getresponse()
        assert answer.status == status
        assert answer.read()
        connection.close()


def test_a_page_for_the_network_goes_by_any_name_but_is_its_own_only():
    door, path = Door("0.0.0.0", "word"), "/?token=word"
    for host, origin in (
        ("robot.local:8080", "http://robot.local:8080"),
        ("Robot.local", "https://robot.local"),
    ):
        assert not door.refusal({"Host": host, "Origin": origin}, path)
    headers = {"Host": "robot.local:8080", "Origin": "http://elsewhere.example"}
    assert door.refusal(headers, path)


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1"])
def test_a_page_for_this_machine_goes_by_all_of_its_names(host):
    for name in ("localhost:8080", "127.0.0.1:8080", "[::1]:8080", "localhost"):
        assert not Door(host).refusal({"Host": name, "Origin": f"http://{name}"})
    for name in ("elsewhere.example", "", "localhost.elsewhere.example"):
        assert Door(host).refusal({"Host": name})


def test_other_servers_of_the_process_are_left_alone():
    serve = websocket_server.serve
    door = Door("127.0.0.1")
    with guarded(door):
        pass
    assert websocket_server.serve is serve
    assert not door.stands
