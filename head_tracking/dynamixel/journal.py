"""What happened on the bus since somebody last asked."""

from __future__ import annotations

from head_tracking.dynamixel.servo_state import BusEvent, EventKind


class Journal:
    """Keeps events until they are handed out with a reading."""

    def __init__(self) -> None:
        self._events: list[BusEvent] = []

    def note(self, kind: EventKind, joint_name: str, servo_id: int, text: str) -> None:
        """Note what happened to a joint."""
        self._events.append(BusEvent(kind, joint_name, f"{joint_name} (id {servo_id}): {text}"))

    def note_port(self, kind: EventKind, text: str) -> None:
        """Note what happened to the port."""
        self._events.append(BusEvent(kind, "", text))

    def take(self) -> tuple[BusEvent, ...]:
        """Return what was noted since the last call, in order."""
        if not self._events:
            return ()
        events, self._events = tuple(self._events), []
        return events
