"""The newest target, placed in a frame: for those who show it."""

from __future__ import annotations

import math
import threading
from typing import NamedTuple

from geometry_msgs.msg import PointStamped
from rclpy.node import Node

from head_tracking.ros.kit.listening import TopicListener
from head_tracking.ros.kit.messages import target_from_message
from head_tracking.tracking import Target, TargetPlacer
from head_tracking.transforms import TransformBuffer, Vector3

_TIMEOUT = 1.0  # s; a target waits so long for its frame


class PlacedTarget(NamedTuple):
    """A target and where it is.

    Attributes:
        placed: when that was found out [ns].
        target: as it was sent.
        point: where it is [m].
    """

    placed: int
    target: Target
    point: Vector3

    @property
    def stamp(self) -> int:
        """When it was there [ns]."""
        return self.target.stamp or self.placed


class NewestTarget:
    """Listens to `target_point`. What is refused is left to the node that turns the head.

    Args:
        node: listens.
        buffer: the robot's frames.
    """

    def __init__(self, node: Node, buffer: TransformBuffer) -> None:
        self._node = node
        self._buffer = buffer
        self._lock = threading.Lock()  # targets come in another thread than they are asked for
        self._placer: TargetPlacer | None = None
        self._newest: PlacedTarget | None = None
        self._listener = TopicListener(node, PointStamped, "target_point", self._on_target)

    def close(self) -> None:
        """Stop listening."""
        self._listener.close()

    def place_in(self, frame: str) -> None:
        """Places targets in this frame from now on."""
        with self._lock:
            self._placer = TargetPlacer(self._buffer, frame, _TIMEOUT)
            self._newest = None

    def newest(self, keep: float = math.inf) -> PlacedTarget | None:
        """The newest target, unless it is older than `keep` [s]."""
        now = self._now
        with self._lock:
            placed = None if self._placer is None else self._placer.place_newest(now * 1e-9, {})
        if placed is not None:
            self._newest = PlacedTarget(now, *placed)
        if self._newest is None or abs(now - self._newest.placed) * 1e-9 > keep:
            return None
        return self._newest

    @property
    def _now(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)

    def _on_target(self, message: PointStamped) -> None:
        with self._lock:
            if self._placer is not None:
                self._placer.offer(target_from_message(message), self._now * 1e-9)
