"""Messages and services for joint owners, epoch and STOP."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.validate_full_topic_name import validate_full_topic_name
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger

from head_tracking.control import STOPPED, JointOwners
from head_tracking.exceptions import HeadTrackingError
from head_tracking.ros.kit.diagnostics import Level, status_message
from head_tracking.ros.kit.threads import UrgentServices
from head_tracking.ros.kit.topics import LATCHED, LONGEST_NAME

_OWNER = "owner of "
_LIMITS = "limits of "
_SERVICE = "service "


class JointControl(NamedTuple):
    """The fields of a `joint_control` message."""

    stopped: bool  # whether everything but `resume` is refused
    epoch: int  # number of STOPs so far
    owners: Mapping[str, str]  # each joint's owner; empty where there is none
    node: str  # full name of the node that publishes it and offers `stop`; empty: not known
    limits: Mapping[str, tuple[float, float]]  # of each joint whose limits are known [rad]
    services: Mapping[str, str]  # full names of its services `stop` and `resume`, as remapped

    def service(self, name: str) -> str:
        """Return the full name of a service; of that node, because short ones may be others'."""
        return self.services.get(name, f"{self.node}/{name}")


def control_message(
    owners: JointOwners,
    joints: Iterable[str],
    node: Node,
    limits: Mapping[str, tuple[float, float]],
) -> DiagnosticStatus:
    """Return a joint_control message of a node."""
    stopped = owners.stopped
    fields = {"stopped": str(stopped).lower(), "epoch": str(owners.epoch.value)}
    fields["node"] = node.get_fully_qualified_name()
    for name in ("stop", "resume"):
        fields[f"{_SERVICE}{name}"] = node.resolve_service_name(f"~/{name}")
    fields |= {f"{_OWNER}{joint}": owner for joint, owner in owners.of(joints).items()}
    fields |= {f"{_LIMITS}{joint}": f"{low} {high}" for joint, (low, high) in limits.items()}
    level, text = (Level.WARN, STOPPED) if stopped else (Level.OK, "commands are accepted")
    return status_message("joint_control", level, text, fields)


def control_from_message(message: DiagnosticStatus) -> JointControl:
    """Return the fields of a joint_control message.

    Raises:
        ValueError: one is missing or malformed.
    """
    fields = {each.key: each.value for each in message.values}
    owners = {k.removeprefix(_OWNER): v for k, v in fields.items() if k.startswith(_OWNER)}
    stopped, epoch = fields.get("stopped") == "true", int(fields.get("epoch", ""))
    node = fields.get("node", "")
    services = {k.removeprefix(_SERVICE): v for k, v in fields.items() if k.startswith(_SERVICE)}
    for name in (node, *services.values()) if node else ():
        try:
            validate_full_topic_name(name)
        except NameValidationException as error:
            raise ValueError(f"{name!r} is not the name of a node or a service") from error
    limits = {}
    for key, value in fields.items():
        if key.startswith(_LIMITS):
            low, high = map(float, value.split())
            if low < high:
                limits[key.removeprefix(_LIMITS)] = low, high
    return JointControl(stopped, epoch, owners, node, limits, services)


def sender(name: str, epoch: int) -> str:
    """Return the `frame_id` of a command or a claim: the sender and the epoch."""
    return f"{name}#{epoch}"


def sender_from(frame_id: str) -> tuple[str, int | None]:
    """Return sender and epoch of a command; the epoch is None if it gives none."""
    name, _, text = frame_id.rpartition("#")
    try:
        epoch = int(text) if name else None
    except ValueError:
        epoch = None
    if epoch is None:
        name = frame_id
    return name[:LONGEST_NAME], epoch  # the name is kept and published as the owner


def stop_report(problems: Mapping[str, str]) -> str:
    """Return the response text of `stop`: each joint is relaxed, or has a problem."""
    return ", ".join(
        f"{joint} NOT confirmed: {problem}" if problem else f"{joint} relaxed"
        for joint, problem in problems.items()
    )


def resume_report(resumed: Iterable[str], refusals: Mapping[str, str]) -> str:
    """Return the response text of `resume`: which controllers continue, and what stays relaxed."""
    names = ", ".join(resumed)
    text = f"{names} goes on, slowly at first" if names else "commands are accepted again"
    return "; ".join([text, *(f"but {joint}: {reason}" for joint, reason in refusals.items())])


def offer_stop(
    services: UrgentServices,
    stop: Callable[[], Mapping[str, str]],
    resume: Callable[[], tuple[Iterable[str], Mapping[str, str]]],
    prefixes: Iterable[str] = ("",),
) -> None:
    """Offer the services `stop` and `resume`.

    Args:
        services: offer them.
        stop: STOP; returns the problem of each joint, or an empty string.
        resume: ends the STOP; returns the controllers that continue, and why joints stay relaxed.
        prefixes: of their names.
    """

    def on_stop(_: Trigger.Request) -> str:
        problems = stop()
        if any(problems.values()):
            raise HeadTrackingError(stop_report(problems))
        return stop_report(problems)

    for prefix in prefixes:
        services.offer(f"{prefix}stop", on_stop)
        services.offer(f"{prefix}resume", lambda _: resume_report(*resume()))


class OwnersOutput:
    """Publishes `joint_owners`, `stopped` and `joint_control`, latched, when they change."""

    def __init__(
        self,
        node: Node,
        owners: JointOwners,
        joints: Iterable[str],
        limits: Callable[[str], tuple[float, float]] | None = None,
    ) -> None:
        self._owners, self._joints, self._limits = owners, tuple(joints), limits
        self._node = node
        self._texts = node.create_publisher(String, "joint_owners", LATCHED)
        self._stops = node.create_publisher(Bool, "stopped", LATCHED)
        self._fields = node.create_publisher(DiagnosticStatus, "joint_control", LATCHED)
        self._last_published: tuple[object, object, object] = None, None, None
        self._lock = threading.RLock()  # or a thread could publish an older state after STOP
        owners.observe(self.publish)
        self.publish()

    def publish(self) -> None:
        """Publish what has changed; call it regularly, because owners expire."""
        with self._lock:
            owners, stopped = self._owners.of(self._joints), self._owners.stopped
            text = String(data="\n".join(f"{joint}: {owner}" for joint, owner in owners.items()))
            limits = {joint: self._limits(joint) for joint in self._joints if self._limits}
            fields = control_message(self._owners, self._joints, self._node, limits)
            before, self._last_published = self._last_published, (text, stopped, fields)
            if fields != before[2]:
                self._fields.publish(fields)
            if text != before[0]:
                self._texts.publish(text)
            if stopped is not before[1]:
                self._stops.publish(Bool(data=stopped))
