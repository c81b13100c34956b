"""Threads of a node: services, other nodes and work that its executor does not delay."""

from __future__ import annotations

import atexit
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from heapq import heappop, heappush
from itertools import count
from typing import Any, Generic, TypeVar

from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_services_default
from rclpy.type_support import check_is_valid_srv_type
from std_srvs.srv import Trigger

from head_tracking.exceptions import HeadTrackingError

T = TypeVar("T")

_POLL = 1.0  # s
_EVENT_PERIOD = 1.0  # s
_MOST = 200  # messages of a subscription in one poll: a flood must not keep the caller
_LOG_PERIOD = 5.0  # s
_PAUSE = 0.05  # s after an error, so that a repeated error does not use a whole core
_PATIENCE = 3.0  # s that a callback or the current work may take at the end


class NodeBeside(Node):
    """A node without parameter services, in the namespace of another node.

    Args:
        beside: gives namespace and context, and the first part of the name.
        name: the last part; `-r __node:=...` of the program changes the first part only.
        options: for the node.
    """

    def __init__(self, beside: Node, name: str, **options: Any) -> None:
        super().__init__(
            name,
            namespace=beside.get_namespace(),
            context=beside.context,
            start_parameter_services=False,
            cli_args=["--ros-args", "-r", f"__node:={beside.get_name()}_{name}"],
            **options,
        )


class NodeThread:
    """Spins a node in a thread of its own.

    An error in a callback is logged; the thread continues. It ends with the program, because a
    thread inside rclpy would abort the interpreter's exit.

    Args:
        node: the node. Clients and subscriptions may be added from any thread until `start`, then
            from its callbacks.
        owns_node: destroy the node at the end.
    """

    def __init__(self, node: Node, *, owns_node: bool = True) -> None:
        self.node = node
        self.executor = SingleThreadedExecutor(context=node.context)
        self.thread = threading.Thread(target=self._spin, name=node.get_name(), daemon=True)
        self._owns_node = owns_node
        self._ending = threading.Event()
        # Executor.wake does not make spin_once return
        self._wake = node.create_guard_condition(lambda: None)

    @classmethod
    def beside(cls, node: Node, name: str) -> NodeThread:
        """Return the thread of a new `NodeBeside`."""
        return cls(NodeBeside(node, name))

    def start(self) -> None:
        """Start spinning."""
        self.executor.add_node(self.node)
        self.thread.start()
        atexit.register(self.close)

    def close(self) -> None:
        """End the thread; may be called twice."""
        atexit.unregister(self.close)
        self._ending.set()
        if self.thread is not threading.current_thread():
            with suppress(InvalidHandle):  # the node has been destroyed
                self._wake.trigger()
            deadline = time.monotonic() + _PATIENCE
            while self.thread.is_alive() and (left := deadline - time.monotonic()) > 0.0:
                with suppress(KeyboardInterrupt):  # a second Ctrl-C
                    self.thread.join(left)
        if self._owns_node and not self.thread.is_alive():
            self.node.destroy_node()

    def _spin(self) -> None:
        context = self.node.context
        try:
            while not self._ending.is_set() and context.ok():
                try:
                    self.executor.spin_once(timeout_sec=_POLL)
                except ExternalShutdownException:
                    return
                except Exception:
                    if self._ending.is_set() or not context.ok():
                        return
                    self.node.get_logger().error(traceback.format_exc())
                    time.sleep(_PAUSE)
        finally:
            self.executor.remove_node(self.node)
            self.executor.shutdown()


class PolledNode(NodeBeside):
    """A node with subscriptions only.

    An error in a callback is logged and costs its message only.

    Args:
        beside: gives the kind of time, too; see `NodeBeside`.
        name: see `NodeBeside`.
    """

    def __init__(self, beside: Node, name: str) -> None:
        sim_time = beside.get_parameter("use_sim_time").value
        overrides = [Parameter("use_sim_time", value=bool(sim_time))]
        super().__init__(beside, name, parameter_overrides=overrides)
        self._polling = threading.Lock()
        self._events = SingleThreadedExecutor(context=beside.context)
        self._events.add_node(self)
        self._events_due = 0.0

    def poll(self) -> None:
        """Call the callbacks of all subscriptions with the messages that have come; never wait."""
        with self._polling:
            for subscription in list(self.subscriptions):
                for _ in range(_MOST):
                    taken = take_message(subscription)
                    if taken is None:
                        break
                    self._call(subscription.callback, taken[0])
            if time.monotonic() >= self._events_due:  # such as a publisher of other reliability
                self._events_due = time.monotonic() + _EVENT_PERIOD
                self._call(self._events.spin_once, 0.0)

    def destroy_node(self) -> None:
        """Wait for a poll in another thread, then destroy the node."""
        with self._polling:
            self._events.shutdown()
            super().destroy_node()

    def _call(self, callback: Callable[..., object], argument: Any) -> None:
        try:
            callback(argument)
        except Exception as error:
            text = f"{type(error).__name__}: {error}"
            self.get_logger().error(text, throttle_duration_sec=_LOG_PERIOD)


def take_message(subscription: Any) -> tuple[Any, dict[str, Any]] | None:
    """Return the next message of a subscription and what the middleware knows of it; or None."""
    with suppress(InvalidHandle), subscription.handle:  # it may be destroyed meanwhile
        taken: tuple[Any, dict[str, Any]] | None = subscription.handle.take_message(
            subscription.msg_type, subscription.raw
        )
        return taken
    return None


def answering(act: Callable[[Any], str]) -> Callable[[Any, Any], Any]:
    """Return the callback of a service of type Trigger or SetBool.

    Args:
        act: receives the request, and returns the message of the answer. A HeadTrackingError or
            TimeoutError that it raises is the reason of an answer without success.
    """

    def answer(request: Any, response: Any) -> Any:
        try:
            response.message = act(request)
            response.success = True
        except (HeadTrackingError, TimeoutError) as error:
            response.message = str(error)
        return response

    return answer


class UrgentServices:
    """Services that each have a thread, which receives requests and calls the callback.

    They belong to the node, have its name and remap rules, but its executor does not know them. Any
    other error than those of `answering` is logged, and is an answer without success.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._services: list[_Service] = []

    def offer(self, name: str, act: Callable[[Any], str], kind: Any = Trigger) -> None:
        """Offer a service of type Trigger or SetBool; for `act` see `answering`."""
        self._services.append(_Service(self._node, kind, name, answering(act)))

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
            waiting.wait(round(1e9 * _POLL))
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


class Worker(Generic[T]):
    """Processes items one at a time in its own thread; of waiting items only the latest one."""

    def __init__(self, name: str, work: Callable[[T], object]) -> None:
        self._work = work
        self._changed = threading.Condition()
        self._latest: list[T] = []
        self._tasks: list[tuple[float, int, Callable[[], object]]] = []  # a heap
        self._order = count()
        self._latest_due = 0.0  # of delayed tasks; monotonic time [s]
        self._error: Exception | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def offer(self, item: T) -> None:
        """Process this item next, and no item that waits.

        Raises:
            Exception: what ended the thread, so that the caller's node ends too.
        """
        if self._error is not None:
            raise self._error
        with self._changed:
            self._latest = [item]
            self._changed.notify()

    def do(self, task: Callable[[], object], delay: float | None = None) -> None:
        """Call a task before the next item, or after `delay` [s]; both kinds keep their order."""
        with self._changed:
            due = time.monotonic()
            if delay is not None:
                due = self._latest_due = max(due + delay, self._latest_due)
            heappush(self._tasks, (due, next(self._order), task))
            self._changed.notify()

    def close(self) -> None:
        """Finish the current work and drop the rest."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(_PATIENCE)

    def _run(self) -> None:
        try:
            while (step := self._next()) is not None:
                step()
        except Exception as error:
            self._error = error

    def _next(self) -> Callable[[], object] | None:
        """Wait for the next work and return it; None at the end."""
        with self._changed:
            while not self._closed:
                wait = self._tasks[0][0] - time.monotonic() if self._tasks else None
                if wait is not None and wait <= 0.0:
                    return heappop(self._tasks)[2]
                if self._latest:
                    item = self._latest.pop()
                    return lambda: self._work(item)
                self._changed.wait(wait)
            return None
