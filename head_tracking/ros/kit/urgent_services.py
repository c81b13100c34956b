"""Services of a node that no callback of its executor delays, and that do not delay each other."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import qos_profile_services_default
from rclpy.type_support import check_is_valid_srv_type

_POLL = 1_000_000_000  # ns
_PATIENCE = 3.0  # s that a callback may take to return at the end


class UrgentServices:
    """Services that each have a thread, which receives requests and calls the callback.

    They belong to the node, have its name and remap rules, but its executor does not know them. An
    error in a callback is logged; the client receives the response as the callback left it.

    Args:
        node: offers them.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._services: list[_Service] = []

    def offer(self, kind: Any, name: str, callback: Callable[[Any, Any], Any]) -> None:
        """Offer a service.

        Args:
            kind: of the service.
            name: as for `Node.create_service`.
            callback: receives request and response, and returns the response.
        """
        self._services.append(_Service(self._node, kind, name, callback))

    def start(self) -> None:
        """Start to receive requests."""
        for service in self._services:
            service.thread.start()

    def close(self) -> None:
        """Withdraw the services; may be called twice."""
        for service in self._services:
            service.end()
        while self._services:
            self._services.pop().withdraw()


class _Service:
    def __init__(self, node: Node, kind: Any, name: str, callback: Callable[..., Any]) -> None:
        check_is_valid_srv_type(kind)
        self._node, self._kind, self._callback = node, kind, callback
        with node.handle:
            self._service = rclpy_implementation.Service(
                node.handle, kind, name, qos_profile_services_default.get_c_qos_profile()
            )
        self._wake = rclpy_implementation.GuardCondition(node.context.handle)
        self._ending = False
        self.thread = threading.Thread(target=self._serve, name=f"service {name}", daemon=True)

    def end(self) -> None:
        self._ending = True
        if self.thread.is_alive():
            self._wake.trigger_guard_condition()

    def withdraw(self) -> None:
        if self.thread.is_alive() and self.thread is not threading.current_thread():
            self.thread.join(_PATIENCE)
        self._service.destroy_when_not_in_use()

    def _serve(self) -> None:
        context = self._node.context
        waiting = rclpy_implementation.WaitSet(0, 1, 0, 0, 1, 0, context.handle)
        while not self._ending and context.ok():
            waiting.clear_entities()
            waiting.add_guard_condition(self._wake)
            waiting.add_service(self._service)
            waiting.wait(_POLL)
            if waiting.get_ready_entities("service"):
                try:
                    self._answer()
                except Exception:
                    self._node.get_logger().error(traceback.format_exc())

    def _answer(self) -> None:
        with self._service:
            request, header = self._service.service_take_request(self._kind.Request)
        if header is None:
            return
        response = self._kind.Response()
        try:
            response = self._callback(request, response)
        finally:
            with self._service:
                self._service.service_send_response(response, header.request_id)
