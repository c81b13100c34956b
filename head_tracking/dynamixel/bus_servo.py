"""A servo as the bus keeps it: whether it answers, what it last said, what it has been told."""

from __future__ import annotations

from enum import IntFlag

from head_tracking.dynamixel.command import Torque
from head_tracking.dynamixel.exceptions import ConfigurationError
from head_tracking.dynamixel.identification import ServoIdentity, identify
from head_tracking.dynamixel.mount import ServoMount
from head_tracking.dynamixel.port import ServoPort
from head_tracking.dynamixel.protocol import NO_ERROR
from head_tracking.dynamixel.servo_link import Feedback, ServoLink
from head_tracking.dynamixel.servo_state import Health, ServoStatistics


class BusServo:
    """State of one servo. Only the thread that owns the bus changes it; any thread may look.

    Args:
        mount: How it is mounted.
        port: Where it is.
        watchdog: Time without any packet after which it shall stop by itself, s; 0: never.

    Attributes:
        id: Its id.
        mount: How it is mounted.
        link: Transactions with it.
        identity: What it said about itself; None until it was found.
        lost: Whether it does not answer and is left out of the cycle.
        failed_cycles: Failed cycles in a row.
        ask_at: Not before this monotonic time, ns, is it asked again.
        interrupted: Whether it has missed a cycle since its torque was last seen.
        faulted: Whether it has shut itself down.
        errors: Its error state when it last told.
        feedback: What it last said; None before it said anything.
        stamp: When that was, ns.
        range: Lowest and highest tick that configuration and servo allow.
        limits: The same as positions of the joint, rad.
    """

    def __init__(self, mount: ServoMount, port: ServoPort, watchdog: float = 0.0) -> None:
        self.id = mount.id
        self.mount = mount
        self.link = ServoLink(port, mount.id, mount.model)
        self.identity: ServoIdentity | None = None
        self.lost = False
        self.failed_cycles = 0
        self.ask_at = 0
        self.interrupted = False
        self.faulted = False
        self.errors: IntFlag = NO_ERROR
        self.feedback: Feedback | None = None
        self.stamp = 0
        self._admit(mount.tick_range, mount)
        self._returned = False  # and has not been read since
        self._watchdog = watchdog if "Bus Watchdog" in mount.model.control_table else 0.0

    @property
    def unseen(self) -> bool:
        """Whether it takes part in the cycle, but the last one has not read it."""
        return not self.lost and (self.failed_cycles > 0 or self._returned)

    @property
    def watched(self) -> bool:
        """Whether it stops by itself when it hears nothing."""
        return self._watchdog > 0.0

    @property
    def health(self) -> Health:
        """What is known about it."""
        if self.identity is None:
            return Health.UNKNOWN
        if self.lost:
            return Health.LOST
        if self.failed_cycles:
            return Health.STALE
        return Health.FAULTED if self.faulted else Health.PRESENT

    def identify(self, keep_torque: bool = False) -> ServoIdentity:
        """Find out what answers, and count it as present from now on.

        Raises:
            CommunicationError: It does not answer.
            ServoError: It is not what the configuration says, or cannot be used.
            ConfigurationError: Its own angle limits leave the joint no range.
        """
        identity = identify(self.link, self.mount, keep_torque)
        self._admit(narrowed(self.mount, identity), self.mount)
        self.identity = identity
        self.lost = self.interrupted = False
        self.failed_cycles = self.ask_at = 0
        return identity

    def remount(self, mount: ServoMount) -> None:
        """Take over other limits; raises ConfigurationError if the servo's own leave nothing."""
        self._admit(
            mount.tick_range if self.identity is None else narrowed(mount, self.identity), mount
        )
        self.mount = mount

    def _admit(self, ticks: tuple[int, int], mount: ServoMount) -> None:
        lower, upper = sorted(mount.position(tick) for tick in ticks)
        self.range = ticks
        self.limits = (lower, upper)

    def answered(self, feedback: Feedback, stamp: int) -> None:
        """Take note of an answer."""
        self.feedback = feedback
        self.stamp = stamp
        self._returned = False
        if self.failed_cycles:
            self.failed_cycles = self.ask_at = 0
            self.interrupted = True

    def failed(self, ask_at: int) -> None:
        """Take note of a cycle without a good answer; `ask_at` is when to ask again, ns."""
        self.failed_cycles += 1
        self.ask_at = ask_at

    def lose(self, ask_at: int) -> None:
        """Leave it out of the cycle and ask it again at a time, ns."""
        self.lost = self._returned = True
        self.ask_at = ask_at
        self.feedback = None

    def pin(self) -> int:
        """Switch torque on where it stands; return the goal, in ticks. See `ServoLink.pin`."""
        if self.watched:
            self.link.set_watchdog(0.0)
        goal = self.link.pin(*self.range, self.mount.fold)
        if self.watched:
            self.link.set_watchdog(self._watchdog)
        self.interrupted = False
        return goal

    def inside(self, ticks: int) -> int:
        """Return the tick moved into what configuration and servo allow."""
        lowest, highest = self.range
        return max(lowest, min(highest, ticks))

    def statistics(self, torque: Torque) -> ServoStatistics:
        """Return what there is to know about it.

        Args:
            torque: Its joint's.
        """
        counters, feedback = self.link.counters, self.feedback
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
            health=Health.STOPPED if torque is Torque.OFF_STOPPED else self.health,
            errors=self.errors,
            last_stamp=self.stamp or None,
            temperature=None if feedback is None else float(feedback.temperature),
            voltage=None if feedback is None else feedback.voltage * 0.1,
            load=None if feedback is None else self.mount.load(feedback.load),
            torque=torque.value,
        )


def narrowed(mount: ServoMount, identity: ServoIdentity) -> tuple[int, int]:
    """Return the range, in ticks, that configuration and servo allow.

    Raises:
        ConfigurationError: They have nothing in common.
    """
    (low, high), (lower, upper) = mount.tick_range, identity.own_range
    lowest, highest = max(low, lower), min(high, upper)
    if lowest >= highest:
        raise ConfigurationError(
            f"{mount.joint_name}: the configuration allows ticks {low} to {high}, "
            f"servo {mount.id} itself {lower} to {upper}: nothing in common; correct min and max "
            "or the servo's angle limits"
        )
    return lowest, highest
