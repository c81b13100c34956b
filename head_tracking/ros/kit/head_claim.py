"""One head for each ROS domain and namespace of several machines; `HeadLock` is for one machine.

Each head publishes one latched message. One head continues: a real one before a simulated one, one
that has begun to move before one that is still discovering others, the older before the younger.
"""

from __future__ import annotations

import json
import os
import socket
import time
import uuid
from collections.abc import Mapping
from typing import Final

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from head_tracking.exceptions import RefusedError
from head_tracking.ros.kit.head_lock import CURES
from head_tracking.ros.kit.qos import LATCHED

# a depth of 1 would be one message of all publishers together
_ALL: Final = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)

LOOK_TIME: Final = 1.5
"""How long a head discovers others [s]; they announce themselves four times a second."""


class HeadClaim:
    """The claim of one head to its domain and namespace, on the latched topic `head_claim`.

    Args:
        node: publishes and subscribes.
        simulated: whether the servos are simulated.
    """

    def __init__(self, node: Node, *, simulated: bool) -> None:
        self._log = node.get_logger()
        self._rank = [simulated, True, time.time(), uuid.uuid4().hex]
        self._first: str | None = None
        self._publisher = node.create_publisher(String, "head_claim", LATCHED)
        node.create_subscription(String, "head_claim", self._on_claim, _ALL)
        self._publish()

    def begin(self) -> None:
        """Take precedence over heads of the same kind that are still discovering others."""
        self._rank[1] = False
        self._publish()

    def check(self) -> None:
        """Raise a RefusedError if another head continues instead of this one."""
        if self._first is not None:
            raise RefusedError(f"another head is in this graph: {self._first}; {CURES}")

    def _publish(self) -> None:
        head = f"process {os.getpid()} on {socket.gethostname()}"
        self._publisher.publish(String(data=json.dumps({"rank": self._rank, "head": head})))

    def _on_claim(self, message: String) -> None:
        try:
            claim = json.loads(message.data)
            rank, head = list(claim["rank"]), str(claim["head"])
            if rank < self._rank:
                self._first = head
            elif rank != self._rank and not rank[1]:
                self._log.warning(f"another head is in this graph: {head}; this one continues")
        except (ValueError, TypeError, KeyError, IndexError):
            self._log.warning(f"head_claim: {message.data[:80]!r} is not the claim of a head")


def is_heard_elsewhere(environment: Mapping[str, str]) -> bool:
    """Return whether other machines can discover nodes that have this environment."""
    reach = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET").upper()
    alone = reach in ("LOCALHOST", "OFF") or environment.get("ROS_LOCALHOST_ONLY") == "1"
    return not alone or bool(environment.get("ROS_STATIC_PEERS"))
