"""Services of a node that no callback of its executor delays, and that delay no other one."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from typing import Any, NamedTuple

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import qos_profile_services_default
from rclpy.type_support import check_is_valid_srv_type

_POLL = 1_000_000_000  # ns
_PATIENCE = 3.0  # s that a callback may take to return at the end


class _Offer(NamedTuple):
    service: Any
    kind: Any
    callback: Callable[[Any, Any], Any]


class UrgentServices:
    """Services that a thread of their own receives; each request is carried out in another one.

    They belong to the node, under its name and with its remap rules, but its executor does not know
    them. A service carries out one request at a time. An error in a callback is logged, and its
    client gets the answer as it was then.

    Args:
        node: offers them.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._offers: list[_Offer] = []
        self._idle = threading.Condition()
        self._busy: set[_Offer] = set()
        self._ending = False
        self._wake = rclpy_implementation.GuardCondition(node.context.handle)
        self._thread = threading.Thread(
            target=self._receive, name=f"{node.get_name()} services", daemon=True
        )

    def offer(self, kind: Any, name: str, callback: Callable[[Any, Any], Any]) -> None:
        """Offer a service from `start` on.

        Args:
            kind: of the service.
            name: as `Node.create_service` takes it.
            callback: gets request and response, and returns the response.
        """
        check_is_valid_srv_type(kind)
        qos = qos_profile_services_default.get_c_qos_profile()
        with self._node.handle:
            service = rclpy_implementation.Service(self._node.handle, kind, name, qos)
        self._offers.append(_Offer(service, kind, callback))

    def start(self) -> None:
        """Receive requests from now on."""
        self._thread.start()

    def close(self) -> None:
        """Withdraw the services; may be called twice."""
        self._ending = True
        if self._thread.is_alive():
            self._wake.trigger_guard_condition()
            self._thread.join(_PATIENCE)
        with self._idle:
            self._idle.wait_for(lambda: not self._busy, _PATIENCE)
        while self._offers:
            self._offers.pop().service.destroy_when_not_in_use()

    def _receive(self) -> None:
        context = self._node.context
        waiting = rclpy_implementation.WaitSet(0, 1, 0, 0, len(self._offers), 0, context.handle)
        while not self._ending and context.ok():
            with self._idle:
                free = [each for each in self._offers if each not in self._busy]
            waiting.clear_entities()
            waiting.add_guard_condition(self._wake)
            for each in free:
                waiting.add_service(each.service)
            waiting.wait(_POLL)
            ready = waiting.get_ready_entities("service")
            for each in free:
                if each.service.pointer in ready:
                    self._begin(each)

    def _begin(self, offer: _Offer) -> None:
        with offer.service:
            request, header = offer.service.service_take_request(offer.kind.Request)
        if header is not None:
            with self._idle:
                self._busy.add(offer)
            threading.Thread(
                target=self._answer, args=(offer, request, header), daemon=True
            ).start()

    def _answer(self, offer: _Offer, request: Any, header: Any) -> None:
        response = offer.kind.Response()
        try:
            response = offer.callback(request, response)
        except Exception:
            self._node.get_logger().error(traceback.format_exc())
        try:
            with offer.service:
                offer.service.service_send_response(response, header.request_id)
        except Exception:
            self._node.get_logger().error(traceback.format_exc())
        finally:
            with self._idle:
                self._busy.discard(offer)
                self._idle.notify_all()
            self._wake.trigger_guard_condition()
