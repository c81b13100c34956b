"""A node that ends other things when it ends."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

from rclpy.node import Node


class ClosingNode(Node):
    """A node that ends other things with it, also if it could not be made completely.

    Since ROS 2 Kilted a context that shuts down destroys its nodes, such ones included.

    Args:
        name: of the node.
        options: for the node.

    Attributes:
        closing: what is called at the end, the last one first.
    """

    def __init__(self, name: str, **options: Any) -> None:
        self.closing = ExitStack()
        super().__init__(name, **options)

    def destroy_node(self) -> None:
        """Ends what is to end with the node, and the node."""
        self.closing.close()
        super().destroy_node()
