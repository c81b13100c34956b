"""node_starter: starts nodes of a run when somebody asks for them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from rclpy.node import Node, NodeNameNonExistentError
from std_srvs.srv import SetBool, Trigger

from head_tracking.control import ControlLoop
from head_tracking.ros.other_services import wait_for_answer
from head_tracking.ros.own_thread import OwnThread
from head_tracking.ros.spinning import describe

_ENABLING = 5.0  # s
_POLL = 0.05  # s


class NodeStarterNode(Node):
    """Offers a service for each node that can be started, by its name.

    Starting takes a while, and waits for other nodes: it has a thread of its own. A node that can
    be switched on is switched on, which lets it take the joints over from the one that has them.

    Args:
        start: starts a node by its name, unless it runs already.
        startable: the names.
        loop: of the process.
    """

    def __init__(
        self,
        start: Callable[[str], None],
        startable: Sequence[str],
        loop: ControlLoop,
        **options: Any,
    ) -> None:
        super().__init__("node_starter", **options)
        self._epoch = loop.owners.epoch
        self._start = start
        own = self.get_fully_qualified_name()
        self._asking = OwnThread(self, f"{self.get_name()}_asking")
        self._enable = {
            name: self._asking.node.create_client(SetBool, f"{name}/enable") for name in startable
        }
        self._answering = OwnThread(self, f"{self.get_name()}_answering")
        for name in startable:
            self._answering.node.create_service(Trigger, f"{own}/{name}", self._callback(name))
        self._asking.start()
        self._answering.start()

    def destroy_node(self) -> None:
        """Starts no more nodes."""
        self._answering.close()
        self._asking.close()
        super().destroy_node()

    def _callback(self, name: str) -> Callable[[Any, Any], Any]:
        def callback(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            epoch = self._epoch.value
            try:
                self._start(name)
            except Exception as error:
                # whatever keeps a node from starting is for the person who asked
                response.message = describe(error)
                self.get_logger().error(f"{name} does not start: {response.message}")
                return response
            if self._epoch.value != epoch:
                response.message = f"{name} runs, and the head was stopped meanwhile"
                return response
            response.success, response.message = self._switch_on(name)
            return response

        return callback

    def _switch_on(self, name: str) -> tuple[bool, str]:
        """Return whether a node that was started does its work, and the words for it."""
        offered = self._services_of(name)
        if offered is None:
            return False, f"{name} was started and has gone again"
        client = self._enable[name]
        if f"{self.get_namespace().rstrip('/')}/{name}/enable" not in offered:
            return True, f"{name} runs"
        if not client.wait_for_service(_ENABLING):
            return False, f"{name} was started and does not answer"
        answer = wait_for_answer(client, SetBool.Request(data=True), _ENABLING)
        if answer is None:
            return False, f"{name} was started and does not answer"
        done = "is switched on" if answer.success else f"is not switched on: {answer.message}"
        return bool(answer.success), f"{name} runs and {done}"

    def _services_of(self, name: str) -> set[str] | None:
        """Return what a node offers, also one of another process that is discovered late."""
        deadline = time.monotonic() + _ENABLING
        while time.monotonic() < deadline:
            with suppress(NodeNameNonExistentError):
                found = self.get_service_names_and_types_by_node(name, self.get_namespace())
                if found:
                    return {service for service, _ in found}
            time.sleep(_POLL)
        return None
