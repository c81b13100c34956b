"""Events of a bus for its log, which shows an event that repeats twice."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Final

from head_tracking.dynamixel.joint import Joint
from head_tracking.dynamixel.state import BusEvent, EventKind

_REPEATS: Final = 30_000_000_000  # ns; an event that comes back sooner repeats
_STUCK: Final = (EventKind.TORQUE_FAILED, EventKind.FAULTED, EventKind.RESTING)


class Events:
    """Collects events until the bus reports them.

    A loose cable, or two servos with one id, make the same events again and again. The second
    event of a kind says that it repeats; further ones are marked as repeated, until there was none
    for 30 s.

    Args:
        monotonic: Time that never jumps, ns.

    Attributes:
        waiting: Events that have not been reported.
    """

    def __init__(self, monotonic: Callable[[], int]) -> None:
        self.waiting: list[BusEvent] = []
        self._monotonic = monotonic
        self._recent: dict[tuple[EventKind, str, Hashable], tuple[int, int]] = {}  # count, ns

    def note(
        self, kind: EventKind, joint: Joint, text: str, stuck: bool = False, about: Hashable = None
    ) -> None:
        """Note what happened to a joint.

        Args:
            kind: What happened.
            joint: To which.
            text: The same for the log.
            stuck: Whether the joint cannot reach its goals.
            about: Which one, of a kind of which a joint may have several at a time.
        """
        text = f"{joint.name} (id {joint.servos[0].id}): {text}"
        now = self._monotonic()
        self._recent = {
            key: (count, last)
            for key, (count, last) in self._recent.items()
            if now - last < _REPEATS
        }
        key = kind, joint.name, about
        count = self._recent.get(key, (0, 0))[0] + 1
        self._recent[key] = count, now
        if count == 2:
            text += "; it repeats, and is not logged again while it does"
        stuck = stuck or kind in _STUCK
        self.waiting.append(BusEvent(kind, joint.name, text, stuck, repeated=count > 2))

    def note_port(self, kind: EventKind, text: str) -> None:
        """Note what happened to the port."""
        self.waiting.append(BusEvent(kind, "", text))

    def take(self) -> tuple[BusEvent, ...]:
        """Return the events that have not been reported, and remove them."""
        if not self.waiting:
            return ()
        events, self.waiting = tuple(self.waiting), []
        return events
