"""A node that a thread of its own spins, so that no other callback delays it."""

from __future__ import annotations

import atexit
import threading
import time
import traceback
from contextlib import suppress

from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

_POLL = 1.0  # s
_PAUSE = 0.05  # s after an error, so that a repeated error does not use a whole core
_PATIENCE = 3.0  # s that a callback may take to return at the end


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
        """Return the thread of a new node without parameters, in the namespace of another node."""
        namespace, context = node.get_namespace(), node.context
        return cls(Node(name, namespace=namespace, context=context, start_parameter_services=False))

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
