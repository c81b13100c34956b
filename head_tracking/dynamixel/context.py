"""What the parts of one bus share, and its log of events."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, field
from typing import Final

from head_tracking.dynamixel.configuration import BusSettings
from head_tracking.dynamixel.joint import BusJoint
from head_tracking.dynamixel.port import DynamixelPort
from head_tracking.dynamixel.requests import RequestQueue
from head_tracking.dynamixel.servo import Servo, Version
from head_tracking.dynamixel.state import BusEvent, EventKind

_REPEATS: Final = 30_000_000_000  # ns; an event that returns sooner is repeated
_STUCK: Final = (EventKind.TORQUE_FAILED, EventKind.FAULTED, EventKind.RESTING)


@dataclass(slots=True)
class BusContext:
    """What the parts of one bus share."""

    port: DynamixelPort
    joints: dict[str, BusJoint]  # by name
    requests: RequestQueue
    settings: BusSettings
    version: Version  # changes with the set of servos that are read
    clock: Callable[[], int]  # of the stamps, ns
    monotonic: Callable[[], int]  # ns
    pause: Callable[[float], object]  # waits a number of seconds, outside of the cycle
    events: list[BusEvent] = field(default_factory=list)  # that have not been reported
    _recent: dict[tuple[EventKind, str, Hashable], tuple[int, int]] = field(default_factory=dict)

    def each_servo(self) -> Iterator[tuple[BusJoint, Servo]]:
        """Yield each servo with its joint."""
        return ((joint, servo) for joint in self.joints.values() for servo in joint.servos)

    def note(
        self,
        kind: EventKind,
        joint: BusJoint,
        text: str,
        stuck: bool = False,
        about: Hashable = None,
    ) -> None:
        """Add an event.

        The second event of a kind says that it repeats; later ones are marked as repeated, until
        there was none for 30 s.

        Args:
            kind: What happened.
            joint: To which joint.
            text: The same for the log.
            stuck: Whether the joint cannot reach its goals.
            about: Distinguishes events of one kind.
        """
        text = f"{joint.name} (id {joint.servos[0].id}): {text}"
        now, key = self.monotonic(), (kind, joint.name, about)
        count, last = self._recent.get(key, (0, 0))
        count = count + 1 if now - last < _REPEATS else 1
        self._recent[key] = count, now
        if count == 2:
            text += "; it repeats, and is not logged again while it does"
        stuck = stuck or kind in _STUCK
        self.events.append(BusEvent(kind, joint.name, text, stuck, repeated=count > 2))

    def take_events(self) -> tuple[BusEvent, ...]:
        """Return and remove the events."""
        events, self.events = tuple(self.events), []
        return events
