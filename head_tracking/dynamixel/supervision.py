"""Who is there: reads servos, notices when one goes and when it comes back."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from head_tracking.dynamixel.bus_joint import BusJoint
from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    ConfigurationError,
    ServoError,
)
from head_tracking.dynamixel.servo_state import BusEvent, EventKind, ServoState


class Supervision:
    """Keeps silent servos from slowing the others, and says once what happened to whom.

    Args:
        clock: Time for the stamps of measurements, ns.
        monotonic: Time that never jumps, ns; decides when a lost servo is asked again.
        retries: How often a failed read is repeated within the same cycle.
        lost_after: Failed cycles in a row after which a servo counts as lost.
        poll_interval: Time between two questions to a lost servo, ns.

    Raises:
        ConfigurationError: A number makes no sense.
    """

    def __init__(
        self,
        clock: Callable[[], int],
        monotonic: Callable[[], int],
        retries: int,
        lost_after: int,
        poll_interval: int,
    ) -> None:
        if retries < 0 or lost_after < 1 or poll_interval <= 0:
            raise ConfigurationError(
                f"retries {retries}, lost_after {lost_after}, poll_interval {poll_interval} ns: "
                "allowed are at least 0, at least 1, above 0"
            )
        self._clock = clock
        self._monotonic = monotonic
        self._retries = retries
        self._lost_after = lost_after
        self._poll_interval = poll_interval
        self._events: list[BusEvent] = []
        self._problems: dict[str, str] = {}

    def read(self, joint: BusJoint) -> ServoState | None:
        """Read a servo; None when it does not answer.

        Raises:
            PortLostError: The port has gone.
        """
        # A servo that failed before gets one try per cycle: each costs the others a timeout.
        retries = 0 if joint.failed_cycles else self._retries
        try:
            return joint.measure(self._clock, retries)
        except CommunicationError as cause:
            if joint.failed_cycles >= self._lost_after:
                joint.lose(self._monotonic() + self._poll_interval)
                text = f"no answer in {joint.failed_cycles} cycles in a row ({cause})"
                self.report(EventKind.LOST, joint, f"{text}; check its cable and power")
            return None

    def poll_one_lost(self, joints: Iterable[BusJoint]) -> None:
        """Ask one lost servo whose time has come; one that answers is relaxed and takes part again.

        One per cycle, because each silent servo costs the others a timeout.

        Raises:
            PortLostError: The port has gone.
        """
        now = self._monotonic()
        for joint in joints:
            if joint.lost and joint.poll_at <= now:
                joint.poll_at = now + self._poll_interval
                self._poll(joint)
                return

    def report(self, kind: EventKind, joint: BusJoint, text: str) -> None:
        """Note something for the next reading."""
        self._events.append(
            BusEvent(kind, joint.name, f"{joint.name} (id {joint.link.id}): {text}")
        )

    def take_events(self) -> tuple[BusEvent, ...]:
        """Return what happened since the last call."""
        events, self._events = tuple(self._events), []
        return events

    def _poll(self, joint: BusJoint) -> None:
        try:
            joint.link.ping()
            joint.identify()
        except CommunicationError:
            return
        except (ServoError, ConfigurationError) as cause:
            if self._problems.get(joint.name) != str(cause):
                self._problems[joint.name] = str(cause)
                self.report(EventKind.UNUSABLE, joint, str(cause))
            return
        self._problems.pop(joint.name, None)
        self.report(EventKind.RETURNED, joint, f"answers again; {joint.torque.value}")
