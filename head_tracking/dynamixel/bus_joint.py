"""A joint as the bus keeps it: its servo, its limits, its torque, its goal."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from head_tracking.dynamixel.command import Goal, Torque, check_finite, within_limits
from head_tracking.dynamixel.configuration import JointConfiguration
from head_tracking.dynamixel.exceptions import (
    CommunicationError,
    GoalError,
    ServoError,
)
from head_tracking.dynamixel.identification import ServoIdentity, identify
from head_tracking.dynamixel.servo_link import SLOWEST, Feedback, ServoLink
from head_tracking.dynamixel.servo_state import ServoState, ServoStatistics


@dataclass(frozen=True, slots=True)
class _WireGoal:
    """What is written each cycle: a tick, and a speed in rad/s (None: the joint's own)."""

    ticks: int
    speed: float | None
    pinned: bool = False


class BusJoint:
    """State of one joint. Only the thread that owns the bus changes it; any thread may look.

    Args:
        configuration: How the joint is wired.
        link: Its servo.

    Attributes:
        name: The joint's name.
        torque: Why it holds or does not hold its position.
        default_speed: Speed for goals that give none, rad/s.
        lost: Whether its servo has stopped answering and is left out of the cycle.
        failed_cycles: Failed cycles in a row.
        poll_at: When a lost servo is asked next, ns.
        identity: What the servo said about itself; None until it was found.
    """

    def __init__(self, configuration: JointConfiguration, link: ServoLink) -> None:
        self.configuration = configuration
        self.link = link
        self.name = configuration.joint_name
        self.torque = Torque.OFF_UNTIL_COMMANDED
        self.default_speed = configuration.joint_speed
        self.lost = False
        self.failed_cycles = 0
        self.poll_at = 0
        self.identity: ServoIdentity | None = None
        self._goal: _WireGoal | None = None
        self._last_ticks: int | None = None
        self._tick_range = configuration.tick_range

    @property
    def limits(self) -> tuple[float, float]:
        """Lowest and highest position, rad, allowed by configuration and servo."""
        one, other = (self.configuration.position(tick) for tick in self._tick_range)
        return (min(one, other), max(one, other))

    @property
    def drives(self) -> bool:
        """Whether goals are written to the servo."""
        return self.torque is Torque.ON and self._goal is not None and not self.lost

    @property
    def goal_position(self) -> float | None:
        """The goal that is being written, rad."""
        return None if self._goal is None else self.configuration.position(self._goal.ticks)

    def admit(self, goal: Goal, clamp: bool) -> float:
        """Return the position to go to, rad, or refuse the goal. Changes nothing.

        Raises:
            GoalError: The goal is no number, outside the limits, or the joint is relaxed on
                request.
        """
        check_finite(self.name, goal)
        if self.torque is Torque.OFF_ON_REQUEST:
            raise GoalError(
                f"{self.name}: command refused, the joint is relaxed on request; switch its torque "
                f"on first (torque_enable true on {self.configuration.controller})"
            )
        lower, upper = self.limits
        tolerance = self.configuration.resolution
        return within_limits(self.name, goal.position, lower, upper, tolerance, clamp)

    # Owner's thread

    def identify(self) -> None:
        """Find out what answers, relax it, and count it as present from now on.

        Raises:
            CommunicationError: It does not answer.
            ServoError: It is not what the configuration says, or cannot be used.
            ConfigurationError: Its own angle limits leave the joint no range.
        """
        identity = identify(self.link, self.configuration)
        self.forget_goal()
        self._tick_range = (identity.lowest, identity.highest)
        self.identity = identity
        self.failed_cycles = 0
        self.lost = False

    def measure(self, clock: Callable[[], int], retries: int) -> ServoState:
        """Read the servo and return its state, stamped with the middle of the transaction.

        Raises:
            CommunicationError: No usable answer; counted in `failed_cycles`.
        """
        before = clock()
        try:
            feedback = self.link.read_feedback(retries)
        except CommunicationError:
            self.failed_cycles += 1
            raise
        self.failed_cycles = 0
        return self._state(feedback, before + (clock() - before) // 2)

    def lose(self, poll_at: int) -> None:
        """Leave the servo out of the cycle and ask it again at a time, ns."""
        self.lost = True
        self.forget_goal()
        self.poll_at = poll_at

    def switch_on(self) -> str:
        """Hold the present position with torque on; return what went wrong, or nothing.

        Raises:
            PortLostError: The port has gone.
        """
        if self.torque is Torque.ON:
            return ""
        if self.lost:
            return "the servo does not answer"
        try:
            ticks = self.link.pin(*self._tick_range)
        except (CommunicationError, ServoError) as cause:
            # The goal alone may have switched torque on.
            with suppress(CommunicationError, ServoError):
                self.link.set_torque(False)
            return str(cause)
        self._goal = _WireGoal(ticks, None, pinned=True)
        self.torque = Torque.ON
        return ""

    def switch_off(self, state: Torque) -> str:
        """Relax the servo, drop the goal; return what went wrong, or nothing.

        Args:
            state: The torque state from now on.

        Raises:
            PortLostError: The port has gone.
        """
        self.torque = state
        self.forget_goal()
        if self.lost:
            self.link.release()
            return "the servo does not answer"
        try:
            self.link.set_torque(False)
        except (CommunicationError, ServoError) as cause:
            return str(cause)
        return ""

    def aim(self, goal: Goal) -> None:
        """Make this the goal that is written from now on."""
        self._goal = _WireGoal(self._inside(self.configuration.ticks(goal.position)), goal.speed)

    def stop(self, retries: int) -> None:
        """Make the present position the goal, at the speed of the previous one.

        A servo that does not answer gets its last known position.

        Raises:
            PortLostError: The port has gone.
        """
        if self._goal is None:
            return
        with suppress(CommunicationError):
            if self.failed_cycles == 0:
                self._last_ticks = self.link.read_position(retries)
        if self._last_ticks is not None:
            ticks = self._inside(self._last_ticks)
            self._goal = _WireGoal(ticks, self._goal.speed, self._goal.pinned)

    def forget_goal(self) -> None:
        """Drop the goal, so that nothing is written any more; torque is not on without one."""
        self._goal = None
        if self.torque is Torque.ON:
            self.torque = Torque.OFF_UNTIL_COMMANDED

    def wire_goal(self) -> bytes:
        """Return the bytes of goal position and moving speed; only while `drives`."""
        assert self._goal is not None
        speed = SLOWEST
        if not self._goal.pinned:
            wanted = self.default_speed if self._goal.speed is None else self._goal.speed
            speed = self.configuration.speed_ticks(wanted)
        return self.configuration.model.goal.encode(self._goal.ticks, speed)

    def statistics(self) -> ServoStatistics:
        """Return the counters of the servo."""
        counters = self.link.counters
        return ServoStatistics(
            joint_name=self.name,
            id=self.configuration.id,
            replies=counters.replies,
            retries=counters.retries,
            timeouts=counters.timeouts,
            corrupt=counters.corrupt,
            failed_cycles=self.failed_cycles,
            lost=self.lost,
        )

    def _state(self, feedback: Feedback, stamp: int) -> ServoState:
        configuration = self.configuration
        self._last_ticks = feedback.ticks
        return ServoState(
            joint_name=self.name,
            id=configuration.id,
            stamp=stamp,
            position=configuration.position(feedback.ticks),
            velocity=configuration.velocity(feedback.speed),
            load=configuration.load(feedback.load),
            voltage=feedback.voltage * 0.1,
            temperature=float(feedback.temperature),
            error=feedback.error,
            torque=self.torque is Torque.ON,
            goal=self.goal_position,
        )

    def _inside(self, ticks: int) -> int:
        lowest, highest = self._tick_range
        return max(lowest, min(highest, ticks))
