"""Clients of the Trigger and SetBool services of other nodes, for calls from any thread."""

from __future__ import annotations

import threading
from typing import Any, NamedTuple

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

_PATIENCE = 5.0  # s


class Outcome(NamedTuple):
    """The result of a request: whether it succeeded, and a sentence for the user."""

    done: bool
    text: str


class OtherServices:
    """Calls services of other nodes.

    Args:
        node: has the clients; another thread must spin it.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._clients: dict[str, Any] = {}
        self._lock = threading.Lock()

    def know(self, kind: type[SetBool] | type[Trigger], *names: str) -> None:
        """Create clients in advance, so that they have discovered their services when called."""
        with self._lock:
            for name in names:
                if name not in self._clients:
                    self._clients[name] = self._node.create_client(kind, name)

    def offered(self, name: str) -> bool:
        """Return whether a node offers a known service."""
        client = self._clients.get(name)
        return client is not None and bool(client.service_is_ready())

    def trigger(self, name: str) -> Outcome:
        """Call a Trigger service."""
        return self._call(name, Trigger.Request())

    def switch(self, name: str, on: bool) -> Outcome:
        """Call a SetBool service."""
        return self._call(name, SetBool.Request(data=on))

    def _call(self, name: str, request: Any) -> Outcome:
        if not self.offered(name):
            return Outcome(False, f"no node offers {name}; is its node running?")
        answer = wait_for_answer(self._clients[name], request)
        if answer is None:
            return Outcome(False, f"{name} did not answer within {_PATIENCE:.0f} s")
        return Outcome(bool(answer.success), str(answer.message))


def wait_for_answer(client: Any, request: Any, patience: float = _PATIENCE) -> Any:
    """Call a service and return its response; None after `patience` [s].

    Another thread must spin the client's node.
    """
    answered = threading.Event()
    future = client.call_async(request)
    future.add_done_callback(lambda _: answered.set())
    if not answered.wait(patience):
        client.remove_pending_request(future)
        return None
    return future.result()
