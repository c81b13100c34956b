"""A servo as the bus keeps it: whether it answers, what it last said, what it has been told."""

from __future__ import annotations

from enum import IntFlag

from head_tracking.dynamixel.exceptions import CommunicationError
from head_tracking.dynamixel.identification import ServoIdentity, identify
from head_tracking.dynamixel.mount import ServoMount
from head_tracking.dynamixel.port import ServoPort
from head_tracking.dynamixel.protocol1 import NO_ERROR
from head_tracking.dynamixel.servo_link import Feedback, ServoLink
from head_tracking.dynamixel.servo_state import Health, ServoStatistics


class BusServo:
    """State of one servo. Only the thread that owns the bus changes it; any thread may look.

    Args:
        mount: How it is mounted.
        port: Where it is.

    Attributes:
        id: Its id.
        mount: How it is mounted.
        link: Transactions with it.
        identity: What it said about itself; None until it was found.
        lost: Whether it has stopped answering and is left out of the cycle.
        failed_cycles: Failed cycles in a row.
        ask_at: Not before this monotonic time, ns, is it asked again.
        faulted: Whether it has shut itself down.
        errors: Its error state when it last told.
        feedback: What it last said; None before it said anything.
        stamp: When that was, ns.
        range: Lowest and highest tick that configuration and servo allow.
        watchdog: Time without any packet after which it shall stop by itself, s; 0 for never.
    """

    def __init__(self, mount: ServoMount, port: ServoPort, watchdog: float = 0.0) -> None:
        self.id = mount.id
        self.mount = mount
        self.link = ServoLink(port, mount.id, mount.model)
        self.identity: ServoIdentity | None = None
        self.lost = False
        self.failed_cycles = 0
        self.ask_at = 0
        self.faulted = False
        self.errors: IntFlag = NO_ERROR
        self.feedback: Feedback | None = None
        self.stamp = 0
        self.range = mount.tick_range
        self.watchdog = watchdog

    @property
    def health(self) -> Health:
        """What is known about it."""
        if self.lost:
            return Health.LOST
        if self.identity is None:
            return Health.UNKNOWN
        if self.failed_cycles:
            return Health.STALE
        return Health.FAULTED if self.faulted else Health.PRESENT

    @property
    def position(self) -> float | None:
        """The joint's position when it last answered, rad."""
        if self.feedback is None:
            return None
        return self.mount.position(self.mount.fold(self.feedback.ticks))

    def identify(self, keep_torque: bool = False) -> ServoIdentity:
        """Find out what answers, and count it as present from now on.

        Raises:
            CommunicationError: It does not answer.
            ServoError: It is not what the configuration says, or cannot be used.
            ConfigurationError: Its own angle limits leave the joint no range.
        """
        identity = identify(self.link, self.mount, keep_torque)
        self.identity = identity
        self.range = (identity.lowest, identity.highest)
        self.lost = self.faulted = False
        self.failed_cycles = self.ask_at = 0
        return identity

    def answered(self, feedback: Feedback, stamp: int) -> None:
        """Take note of an answer."""
        self.feedback = feedback
        self.stamp = stamp
        self.failed_cycles = 0
        self.ask_at = 0

    def failed(self, ask_at: int) -> None:
        """Take note of a cycle without a good answer."""
        self.failed_cycles += 1
        self.ask_at = ask_at

    def lose(self, ask_at: int) -> None:
        """Leave it out of the cycle and ask it again at a time, ns."""
        self.lost = True
        self.ask_at = ask_at

    def pin(self) -> int:
        """Switch torque on where it stands; return the goal, in ticks. See `ServoLink.pin`."""
        self.link.set_watchdog(0.0)
        goal = self.link.pin(*self.range, self.mount.fold)
        if self.watchdog:
            self.link.set_watchdog(self.watchdog)
        return goal

    def inside(self, ticks: int) -> int:
        """Return the tick moved into what configuration and servo allow."""
        lowest, highest = self.range
        return max(lowest, min(highest, ticks))

    def look_for_errors(self) -> IntFlag:
        """Ask for the error state that goes with the last answer, and return it.

        Raises:
            CommunicationError: The servo does not answer.
        """
        if self.feedback is None:
            raise CommunicationError(f"servo {self.id} has not answered yet")
        self.errors = self.link.errors(self.feedback.error)
        return self.errors

    def statistics(self, stopped: bool) -> ServoStatistics:
        """Return the counters."""
        counters = self.link.counters
        return ServoStatistics(
            joint_name=self.mount.joint_name,
            id=self.id,
            replies=counters.replies,
            retries=counters.retries,
            timeouts=counters.timeouts,
            corrupt=counters.corrupt,
            failed_cycles=self.failed_cycles,
            lost=self.lost,
            model=self.mount.model.name,
            firmware_version=None if self.identity is None else self.identity.firmware_version,
            health=Health.STOPPED if stopped else self.health,
            errors=self.errors,
            last_stamp=None if self.feedback is None else self.stamp,
        )
