"""One head for each ROS domain and namespace of several machines, and its STOP over a restart."""

from __future__ import annotations

import json
import os
import socket
import threading
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from head_tracking.control import JointOwners
from head_tracking.exceptions import RefusedError
from head_tracking.ros.kit.head_lock import CURES, domain_and_namespace, node_name
from head_tracking.ros.kit.topics import LATCHED
from head_tracking.share import state_folder

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
            simulated, searches, began, name = claim["rank"]
            rank, head = [bool(simulated), bool(searches), float(began), str(name)], claim["head"]
            if rank < self._rank:
                self._first = str(head)
            elif rank != self._rank and not searches:
                self._log.warning(f"another head is in this graph: {head}; this one continues")
        except Exception:  # a RecursionError, too
            self._log.warning(
                f"head_claim: {message.data[:80]!r} is not the claim of a head",
                throttle_duration_sec=1.0,
            )


def is_heard_elsewhere(environment: Mapping[str, str]) -> bool:
    """Return whether other machines can discover nodes that have this environment."""
    reach = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET").upper()
    alone = reach in ("LOCALHOST", "OFF") or environment.get("ROS_LOCALHOST_ONLY") == "1"
    return not alone or any(map(environment.get, ("ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER")))


class KeptStop:
    """Keeps the STOP of a real head in a file until `resume` or `forget`.

    Args:
        arguments: of ROS; they may set the namespace.
        node: the only node of the program, as it is usually named; empty: a run.
    """

    def __init__(self, arguments: Sequence[str], node: str = "") -> None:
        name = f"-{node_name(arguments, node)}" if node else ""
        place = f"domain_{domain_and_namespace(arguments)}"
        self._file = state_folder("stopped") / f"{place}{name}"
        self._is_kept = False
        self._lock = threading.RLock()  # or `resume` could delete the file of a STOP after it

    def guard(self, owners: JointOwners) -> None:
        """Stop the head if it was stopped before and not resumed; keep each STOP from now on."""
        if self._file.exists():
            get_logger("head_tracking").warning(
                "the head was stopped before and not resumed: it is still stopped; call resume"
            )
            owners.stop(dict)
            self._is_kept = True
        owners.observe(lambda: self._keep(lambda: owners.stopped))

    def forget(self) -> None:
        """Discard the STOP, because the program has ended normally."""
        self._keep(lambda: False)

    def _keep(self, is_stopped: Callable[[], bool]) -> None:
        with self._lock:
            stopped = is_stopped()
            if stopped is self._is_kept:
                return  # a file that is there is the STOP of another program
            self._is_kept = stopped
            try:
                if stopped:
                    self._file.parent.mkdir(parents=True, exist_ok=True)
                    self._file.touch()
                else:
                    self._file.unlink(missing_ok=True)
            except OSError as error:
                log = get_logger("head_tracking")
                log.warning(f"the STOP cannot be kept over a crash: {error}")
