"""A node with resources that end with it."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

from rclpy.node import Node


class ClosingNode(Node):
    """A node that calls `closing` when it is destroyed, also if its constructor has failed.

    Since ROS 2 Kilted a context that shuts down destroys its nodes, also incomplete ones.

    Args:
        name: of the node.
        options: for the node.

    Attributes:
        closing: callbacks, the last one first.
    """

    def __init__(self, name: str, **options: Any) -> None:
        self.closing = ExitStack()
        super().__init__(name, **options)

    def destroy_node(self) -> None:
        """Call `closing`, then destroy the node."""
        self.closing.close()
        super().destroy_node()
