"""The services of other nodes, found at run time, and called from any thread."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from head_tracking.viewer.robot import Outcome

_KINDS: dict[str, Any] = {"std_srvs/srv/SetBool": SetBool, "std_srvs/srv/Trigger": Trigger}
_PATIENCE = 5.0  # s


class RunningServices:
    """Clients for the switches and triggers that other nodes offer.

    `look` must be called in the node's thread; the rest may be called from any other one.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._clients: dict[str, Any] = {}
        self._offered: set[str] = set()

    def look(self, wanted: Callable[[str], bool]) -> None:
        """Makes clients for services that came, and drops those of services that went.

        A service that nobody offers any more is still listed as long as it has a client: its own.
        """
        found = {
            name: _KINDS[types[0]]
            for name, types in self._node.get_service_names_and_types()
            if types[0] in _KINDS and wanted(name)
        }
        clients = dict(self._clients)
        offered = {name for name, client in clients.items() if _is_offered(client)}
        gone = (clients.keys() - found.keys()) | (self._offered - offered)
        for name in gone:
            self._node.destroy_client(clients.pop(name))
        for name in found.keys() - clients.keys() - gone:
            clients[name] = self._node.create_client(found[name], name)
        self._clients, self._offered = clients, offered - gone

    def names(self, ending: str) -> tuple[str, ...]:
        """The services that are offered now and whose names end so, sorted."""
        return tuple(
            sorted(
                name
                for name, client in self._clients.items()
                if name.endswith(ending) and _is_offered(client)
            )
        )

    def trigger(self, name: str) -> Outcome:
        """Calls a Trigger service."""
        return self._call(name, Trigger.Request())

    def switch(self, name: str, on: bool) -> Outcome:
        """Calls a SetBool service."""
        return self._call(name, SetBool.Request(data=on))

    def _call(self, name: str, request: Any) -> Outcome:
        client = self._clients.get(name)
        if client is None:
            return Outcome(False, f"nobody offers {name}; is its node running?")
        answer = wait_for_answer(client, request)
        if answer is None:
            return Outcome(False, f"{name} did not answer within {_PATIENCE:.0f} s")
        return Outcome(bool(answer.success), str(answer.message))


def _is_offered(client: Any) -> bool:
    try:
        return bool(client.service_is_ready())
    except InvalidHandle:
        return False  # dropped by `look` just now


def wait_for_answer(client: Any, request: Any) -> Any:
    """What a service answers, while another thread spins the node; None if it does not."""
    answered = threading.Event()
    future = client.call_async(request)
    future.add_done_callback(lambda _: answered.set())
    if not answered.wait(_PATIENCE):
        client.remove_pending_request(future)
        return None
    return future.result()
