"""The latest target, transformed into a frame, for display."""

from __future__ import annotations

import threading
from typing import NamedTuple

from geometry_msgs.msg import PointStamped
from rclpy.node import Node

from head_tracking.ros.kit.target_point import target_from_message
from head_tracking.ros.kit.topics import TopicListener
from head_tracking.tracking import Target, TargetPlacer
from head_tracking.transforms import TransformBuffer, Vector3

_TIMEOUT = 1.0  # s to wait for the transform of a target


class TransformedTarget(NamedTuple):
    """A target and its position in the requested frame."""

    target: Target  # the published target
    point: Vector3  # position [m]
    stamp: int  # time of the target; if it has none, of the transformation [ns]


class LatestTarget:
    """Subscribes to `target_point`; ignores invalid targets, which the head's node reports."""

    def __init__(self, node: Node, buffer: TransformBuffer) -> None:
        self._node = node
        self._buffer = buffer
        self._lock = threading.Lock()  # callbacks and callers are in different threads
        self._placer: TargetPlacer | None = None
        self._latest: TransformedTarget | None = None
        TopicListener(node, PointStamped, "target_point", self._on_target)

    def place_in(self, frame: str) -> None:
        """Transform targets into this frame."""
        with self._lock:
            self._placer = TargetPlacer(self._buffer, frame, _TIMEOUT)
            self._latest = None

    def latest(self) -> TransformedTarget | None:
        """Return the latest target; None: none has come."""
        now = self._now
        with self._lock:
            placer = self._placer
            placed = [] if placer is None else placer.place(now * 1e-9, {}, latest_only=True)
        for target, point in placed:
            self._latest = TransformedTarget(target, point, target.stamp or now)
        return self._latest

    @property
    def _now(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)

    def _on_target(self, message: PointStamped) -> None:
        with self._lock:
            if self._placer is not None:
                self._placer.offer(target_from_message(message), self._now * 1e-9)
