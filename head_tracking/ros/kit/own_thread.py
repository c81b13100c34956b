"""A node with an executor and a thread of its own, for what no other callback may delay."""

from __future__ import annotations

import threading
import time
import traceback

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

_POLL = 1.0  # s
_PAUSE = 0.05  # s after an error: one that comes back takes no core
_PATIENCE = 3.0  # s that a callback may take to return at the end


class OwnThread:
    """Spins a node of its own, in the namespace of the node that it belongs to.

    What goes wrong in a callback is logged and ends neither the node nor the thread.

    Args:
        beside: the node that it belongs to.
        name: of the new one, which offers no parameters.

    Attributes:
        node: the new node. Clients and subscriptions may be added from any thread until `start`,
            afterwards from its callbacks.
    """

    def __init__(self, beside: Node, name: str) -> None:
        self.node = Node(
            name,
            namespace=beside.get_namespace(),
            context=beside.context,
            start_parameter_services=False,
        )
        self._ending = threading.Event()
        # At Executor.wake spin_once looks around and waits on.
        self._end = self.node.create_guard_condition(lambda: None)
        self._thread = threading.Thread(target=self._spin, name=name, daemon=True)

    def start(self) -> None:
        """Spins from now on."""
        self._thread.start()

    def close(self) -> None:
        """Ends the thread and the node; may be called twice."""
        self._ending.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._end.trigger()
            self._thread.join(_PATIENCE)
        if not self._thread.is_alive():
            self.node.destroy_node()

    def _spin(self) -> None:
        executor = SingleThreadedExecutor(context=self.node.context)
        executor.add_node(self.node)
        try:
            while not self._ending.is_set() and self.node.context.ok():
                try:
                    executor.spin_once(timeout_sec=_POLL)
                except ExternalShutdownException:
                    return
                except Exception:
                    if not self.node.context.ok():
                        return
                    self.node.get_logger().error(traceback.format_exc())
                    time.sleep(_PAUSE)
        finally:
            executor.remove_node(self.node)
            executor.shutdown()
