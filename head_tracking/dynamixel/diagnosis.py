"""Find faults of servos, and protect them: relax or hold a joint that must not go on.

A fault is found by comparing measurements with goals, and by the error bits of the servo. Before
a servo that does not follow its goal is reported, a few of its registers are read, to find the
cause. The thresholds were chosen with the simulator:
test/dynamixel/test_dynamixel_named_faults.py.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from enum import IntFlag
from typing import Final

from head_tracking.dynamixel.exceptions import CommunicationError
from head_tracking.dynamixel.joint import BusJoint
from head_tracking.dynamixel.procedures import Procedures
from head_tracking.dynamixel.protocol import NO_ERROR, REFUSALS, ErrorBits, describe_errors
from head_tracking.dynamixel.requests import Steps
from head_tracking.dynamixel.servo import LinkState, Servo, ServoIdentity, wrong_mode
from head_tracking.dynamixel.state import EventKind, ServoState, Symptom

_GONE: Final = 1.0  # s without a symptom until it is cleared
_AGAIN: Final = 1.0  # s between two examinations of a servo
_ASK: Final = 500_000_000  # ns after a question for the torque of a servo
_ASK_PAIR: Final = 100_000_000  # the same, if another servo turns its joint as well
_MOVES: Final = 0.3  # rad/s
_DRIVES: Final = 0.15  # of full torque
_LONGEST_READ: Final = 64  # bytes
_NEAR: Final = 0.1  # rad; closer to its goal a servo may be slow
_FAR: Final = 0.3  # rad
_ARRIVED: Final = 5.0  # ticks
_STRENGTHS: Final = ("Max Torque", "Torque Limit", "PWM Limit", "Goal PWM")
_CAUSES: Final = ("Goal Position", "Bus Watchdog", *_STRENGTHS)
"""Registers with causes, besides modes and position limits."""
_TORQUE_LOST: Final = (
    "its torque is off, but this program has not switched it off: its supply, or another "
    "program; the joint is relaxed until the next command"
)
_CROSSED: Final = (
    "it was turned over the end of its scale, and would turn all round to its goal; the joint is "
    "relaxed: turn it back by hand, then switch its torque on"
)
_SWITCHED_ON: Final = "another program has switched its torque on; it is relaxed again"


# For the bus and for command line tools


def conditions(
    servo: Servo, warm: float, share: float = 0.8, slack: float = 0.0
) -> dict[Symptom, str]:
    """Return low supply and high temperature of an identified servo, a sentence each.

    Args:
        servo: The servo, as read last.
        warm: Temperature of the symptom, °C; at most 8 degrees below the servo's own limit.
        share: Share of the nominal voltage; less is low, and so is less than 0.5 V above the
            servo's own limit.
        slack: Hysteresis of the temperature, °C.
    """
    identity, volts, celsius = servo.identity, servo.voltage, servo.temperature
    found: dict[Symptom, str] = {}
    if identity is None:
        return found
    nominal = servo.model.nominal_voltage
    if volts < share * nominal or volts < identity.lowest_voltage + 0.5:
        found[Symptom.SUPPLY] = (
            f"its supply is {volts:.1f} V instead of {nominal:.1f} V, and its Min Voltage Limit is "
            f"{identity.lowest_voltage:.1f} V: charge the battery, or use a stronger supply"
        )
    if celsius >= min(warm, identity.temperature_limit - 8.0) - slack:
        found[Symptom.WARM] = (
            f"it is at {celsius:.0f} °C; at {identity.temperature_limit:.0f} °C it shuts itself "
            "down: reduce its load"
        )
    return found


def swapped(servos: Iterable[Servo]) -> dict[int, Servo]:
    """Return servos, by id, that have the angle limits of another servo's joint in their memory."""
    found: dict[int, Servo] = {}
    servos = tuple(servos)
    for servo in servos:
        if servo.identity is None:
            continue
        own = servo.identity.own_range
        if own in (servo.calibration.tick_range, (0, servo.model.ticks - 1)):
            continue  # the factory's
        for other in servos:
            if other is not servo and other.calibration.tick_range == own:
                found.setdefault(servo.id, other)
    return found


class _Watch:
    """Measurements of a servo in this cycle, and what detectors keep from earlier ones."""

    def __init__(self, joint: BusJoint, servo: Servo, index: int) -> None:
        self.joint, self.servo, self.index = joint, servo, index
        self.tick = servo.model.radians_per_tick
        self.now = self.cycle = 0  # ns; number of the cycle
        self.elapsed = self.step = self.error = self.asked = 0.0
        self.identity: ServoIdentity | None = None
        self.read_at = 0.0
        self.position = 0.0
        self.ticks = 0  # as the servo counts them
        self.symptoms: dict[Symptom, str] = {}
        self.seen: dict[Symptom, int] = {}
        self.since: dict[str, tuple[int, int]] = {}  # ns, and the last cycle in which it held
        self.examined = -math.inf
        self.errors_read = 0  # ns
        self.reported: IntFlag = NO_ERROR  # error bits
        self.failed = 0  # transactions so far
        self.failures: list[int] = []
        self.goals: deque[int] = deque(maxlen=5)
        self.pace_target: tuple[int, ...] = ()
        self.usual_voltage = self.jump = self.away_speed = 0.0
        self.pace_since, self.pace_begin, self.pace_error, self.pace_asked = 0, 0.0, 0.0, 0.0
        self.rest_position = self.rest_error = self.owed = 0.0

    @property
    def off(self) -> str:
        """How far it is from its goal."""
        return f"it stands {abs(self.error):.2f} rad from its goal"

    def lasting(self, what: str, seconds: float) -> bool:
        """Return whether a condition has held for so long; call it while the condition holds."""
        first, last = self.since.get(what, (self.now, 0))
        if last != self.cycle - 1:
            first = self.now
        self.since[what] = first, self.cycle
        return self.now - first >= seconds * 1e9

    def forget_motion(self) -> None:
        """Start again, because it does not follow goals, or was not read."""
        self.pace_since = self.now
        self.rest_position, self.owed = self.position, 0.0


# Detectors: each returns a symptom and a sentence, or None

Found = tuple[Symptom, str] | None


def _jump(watch: _Watch) -> Found:
    """Find a step that no motor can make, without a step back."""
    if not (watch.joint.on and 0.0 < watch.elapsed < 0.1):
        return None
    far = 2.0 * watch.servo.model.no_load_speed * watch.elapsed + 8.0 * watch.tick
    jumps = abs(watch.step) > far
    before, watch.jump = watch.jump, watch.step if jumps else 0.0
    if jumps or not before:
        return None
    return Symptom.JUMP, (
        f"its position jumped by {before:+.2f} rad in a cycle: a dirty or loose encoder, or "
        "a broken gear"
    )


def _frozen(watch: _Watch) -> Found:
    """Find a constant position, not at the end of its scale, with a speed."""
    servo, speed = watch.servo, abs(watch.servo.velocity)
    if watch.step or speed < _MOVES or servo.ticks in (0, servo.model.ticks - 1):
        return None
    if not watch.lasting("frozen", max(0.12, 10.0 * watch.tick / speed)):
        return None
    return Symptom.FROZEN, (
        f"it measures {servo.velocity:+.1f} rad/s, but its position stays at {servo.position:.3f} "
        "rad: its encoder is frozen"
    )


def _sag(watch: _Watch) -> Found:
    """Find a voltage that falls by a tenth of the nominal voltage in a short time."""
    volts, usual = watch.servo.voltage, watch.usual_voltage
    watch.usual_voltage += (0.1 if volts > usual else 0.001) * (volts - usual)
    falls = usual - volts >= 0.1 * watch.servo.model.nominal_voltage
    if not (falls and watch.lasting("sag", 0.06)):
        return None
    return Symptom.SAG, (
        f"its supply falls from {usual:.1f} to {volts:.1f} V under load: too weak, or a thin cable "
        "or bad plug"
    )


def _line(watch: _Watch) -> Found:
    """Find 4 transactions that failed within 0.3 s, with a servo that answers."""
    failed = watch.servo.counters.failed
    watch.failures += [watch.now] * min(4, failed - watch.failed)
    watch.failed = failed
    watch.failures = [when for when in watch.failures if watch.now - when <= 300_000_000]
    if len(watch.failures) < 4 or not watch.servo.answers:
        return None
    return Symptom.LINE, (
        f"{len(watch.failures)} transactions failed within 0.3 s, though it answers: plugs, "
        "cables, ground, or two servos with one id"
    )


def _apart(watch: _Watch) -> Found:
    """Find that the two servos of a joint are apart."""
    first, second = watch.joint.servos
    apart = abs(first.position - second.position)
    comparable = first.answers and second.answers and not watch.joint.busy
    far = comparable and apart >= 0.06 + 0.02 * abs(first.velocity)
    if not (far and watch.lasting("apart", 0.06)):
        return None
    return Symptom.APART, (
        f"it and servo {second.id}, which turn one joint, are {apart:.2f} rad apart: a horn has "
        "slipped, or one is mounted or calibrated the wrong way round"
    )


def _away(watch: _Watch) -> Found:
    """Find that it turns away from its goal; braking before it turns round may take longer."""
    speed = watch.servo.velocity
    turns_away = speed * watch.error < 0.0 and abs(speed) >= _MOVES and abs(watch.error) >= 0.1
    if not turns_away:
        watch.away_speed = abs(speed)
        return None
    patience = 0.12 if abs(speed) >= 0.8 * watch.away_speed else 0.2
    if not watch.lasting("away", patience):
        return None
    return Symptom.AWAY, (
        f"it turns away from its goal at {speed:+.1f} rad/s: something pushes it, or its motor is "
        "defective"
    )


def _slow(watch: _Watch) -> Found:
    """Find less than 35 % of the goal speed for 0.16 s, after 0.1 s to accelerate.

    Within 0.3 rad of a goal that changes, a tracking law may ask for more speed than it needs. When
    the goal speed has doubled, the servo may accelerate anew.
    """
    servo, error, now, position = watch.servo, watch.error, watch.now, watch.position
    target = watch.joint.goal_ticks
    if abs(error) >= _FAR:
        watch.pace_target = target
    near = abs(error) < _NEAR or target != watch.pace_target
    moves = servo.velocity * error > 0.0 and watch.asked >= _MOVES
    rises = watch.asked > 2.0 * watch.pace_asked
    if near or not moves or rises or watch.pace_error * error < 0.0:
        watch.pace_since, watch.pace_begin, watch.pace_error = now, position, error
        watch.pace_target, watch.pace_asked = target, watch.asked
        return None
    watch.pace_asked = min(watch.pace_asked, watch.asked)
    seconds = (now - watch.pace_since) * 1e-9
    if seconds < 0.1:
        watch.pace_begin = position
    if seconds < 0.26:
        return None
    moved = abs(position - watch.pace_begin)
    watch.pace_since, watch.pace_begin = now - 100_000_000, position
    share = servo.voltage / servo.model.nominal_voltage if servo.voltage else 1.0
    fastest = servo.model.no_load_speed * min(1.0, share)
    if moved >= 0.35 * min(watch.asked, 0.9 * fastest) * 0.16:
        return None
    return Symptom.SLOW, (
        f"it turns at {abs(servo.velocity):.1f} rad/s, far below the goal speed, at "
        f"{servo.voltage:.1f} V and {abs(servo.load):.0%} of its torque: friction, load, a weak "
        "supply, or a low limit of speed or acceleration in its memory"
    )


def _stuck(watch: _Watch) -> Found:
    """Find that it stands away from its goal; its load shows whether it is blocked or idle.

    It stands if it has not moved a short distance in the time that this and a tick of noise take at
    the goal speed, with 0.1 s to accelerate, and 0.1 s more to turn round. A servo that holds a
    weight stands a little off, with load. A late cycle counts as 0.02 s, because the goal may have
    come late.
    """
    error, off, load = watch.error, abs(watch.error), abs(watch.servo.load)
    way = max(0.012, 2.5 * watch.tick)
    turns = error * watch.rest_error < 0.0
    watch.rest_error = error or watch.rest_error
    if turns or abs(watch.position - watch.rest_position) >= way:
        watch.rest_position = watch.position
        watch.owed = -0.1 if turns else 0.0
    patience = max(0.12, 0.1 + (1.3 * way + watch.tick) / max(watch.asked, 1e-3))
    if off > 0.12 or (off > 0.06 and not _DRIVES <= load <= 0.6):
        watch.owed += min(watch.elapsed, 0.02)
        if watch.owed < patience:
            return None
        if load < _DRIVES:
            return (
                Symptom.IDLE,
                f"{watch.off} and has no load, with torque on: motor, gear, low gain",
            )
        return Symptom.BLOCKED, (
            f"{watch.off} and has a load of {load:.0%}: an obstacle, an end stop (has a horn "
            "slipped?), or a frozen encoder"
        )
    return None


_READ: Final = (_jump, _frozen, _sag)
"""For every servo that was read."""

_FOLLOWING: Final = (_away, _slow, _stuck)
"""For servos with a goal; registers are read before one of these is reported."""


class Diagnosis:
    """Examines all servos once a cycle, after they were read.

    Args:
        bus: Relaxes joints, clears watchdogs.
    """

    def __init__(self, bus: Procedures) -> None:
        self._bus, self._settings = bus, bus.settings
        self._joints = [
            (joint, [_Watch(joint, servo, i) for i, servo in enumerate(joint.servos)])
            for joint in bus.joints.values()
        ]
        self._watches = {each.servo.id: each for _, watches in self._joints for each in watches}
        self._turns = deque(self._watches.values())  # the one that was asked last comes first
        self._ask_at = 0  # ns

    def of(self, servo_id: int) -> dict[Symptom, str]:
        """Return the symptoms of a servo, a sentence each."""
        return dict(self._watches[servo_id].symptoms)

    def report_swapped(self) -> None:
        """Report servos with the angle limits of another joint in their memory."""
        for servo_id, other in swapped(each.servo for each in self._watches.values()).items():
            name = other.calibration.joint_name
            text = f"its memory holds the angle limits of {name}: have two servos been swapped?"
            self._report(self._watches[servo_id], Symptom.SWAPPED, text)

    def examine(self, now: int) -> None:
        """Run all detectors; `now` is monotonic, ns."""
        for joint, watches in self._joints:
            for watch in watches:
                servo = watch.servo
                watch.now = now
                watch.cycle += 1
                if watch.symptoms:
                    self._clear(watch)
                if joint.on:
                    watch.goals.append(joint.goal_ticks[watch.index])  # also if it did not answer
                if servo.counters.failed != watch.failed:
                    self._find(watch, _line)
                if servo.read_at != watch.read_at and servo.link is LinkState.PRESENT:
                    self._examine(watch)
                else:
                    watch.forget_motion()
            if len(watches) > 1:
                self._find(watches[0], _apart)
        self._ask_next(now)

    def _examine(self, watch: _Watch) -> None:
        """Examine a servo that was read in this cycle."""
        joint, servo = watch.joint, watch.servo
        watch.elapsed = servo.read_at - watch.read_at
        step = servo.position - watch.position
        if servo.model.endless:
            step = math.remainder(step, servo.model.ticks * watch.tick)
        watch.step, watch.position, watch.read_at = step, servo.position, servo.read_at
        crossed = watch.elapsed < 0.1 and abs(servo.ticks - watch.ticks) > 0.75 * servo.model.ticks
        watch.ticks = servo.ticks
        if watch.identity is not servo.identity:
            watch.identity, watch.usual_voltage, watch.step = servo.identity, servo.voltage, 0.0
        for find in _READ:
            self._find(watch, find)
        slack = 3.0 if Symptom.WARM in watch.symptoms else 0.0
        warn = self._settings.temperature.warn
        for symptom, text in conditions(servo, warn, slack=slack).items():
            if symptom is Symptom.WARM or watch.lasting("low supply", 0.06):
                self._report(watch, symptom, text)
        if not joint.on or joint.busy:
            watch.forget_motion()
            return
        if crossed:
            self._report(watch, Symptom.AWAY, _CROSSED)
            joint.relaxed = True  # a stream of commands would switch it on
            self._bus.cut(joint)
            return
        watch.error = servo.calibration.position(joint.goal_ticks[watch.index]) - servo.position
        asked = joint.default_speed if joint.goal_speed is None else joint.goal_speed
        watch.asked = min(asked, servo.fastest * servo.model.speed_unit)
        for find in _FOLLOWING:
            if found := find(watch):
                self._suspect(watch, *found)

    def _suspect(self, watch: _Watch, suspicion: Symptom, text: str) -> None:
        """Read the registers of a servo that does not follow, at most once a second."""
        for known in watch.symptoms:
            if known.serious:
                watch.seen[known] = watch.now
        if watch.now - watch.examined < _AGAIN * 1e9:
            return
        watch.examined = watch.now
        self._bus.requests.start(self._examining(watch, suspicion, text))

    def _examining(self, watch: _Watch, suspicion: Symptom, text: str) -> Steps[None]:
        joint, servo = watch.joint, watch.servo
        yield from self._asking(watch)
        for last in (False, True):
            try:
                wanted = (*_CAUSES, *servo.model.modes, *servo.model.position_limits)
                spans = servo.model.control_table.spans(_LONGEST_READ, wanted)
                values = yield from servo.read_named(spans, 2)
            except CommunicationError:
                watch.examined = -math.inf
                return
            if not joint.on or joint.busy:
                return  # it was relaxed meanwhile
            watch.goals.append(joint.goal_ticks[watch.index])  # not every cycle is examined
            symptom, why = _cause(watch, values) or (suspicion, text)
            if symptom is not Symptom.OVERRULED or last:
                break  # a goal that was written late is not another program's
        self._report(watch, symptom, why)
        if symptom is Symptom.MODE:
            self._bus.cut(joint)
        elif symptom is Symptom.TRIPPED:
            self._bus.clear_watchdog(joint)

    def _find(self, watch: _Watch, find: Callable[[_Watch], Found]) -> None:
        if found := find(watch):
            self._report(watch, *found)

    def _report(self, watch: _Watch, symptom: Symptom, text: str) -> None:
        watch.seen[symptom] = watch.now
        if symptom in watch.symptoms:
            return
        watch.symptoms[symptom] = text
        joint, servo = watch.joint, watch.servo
        kind = EventKind.TORQUE_LOST if symptom is Symptom.TORQUE_LOST else EventKind.SYMPTOM
        text = f"servo {servo.id}: {symptom.value}: {text}"
        self._bus.note(kind, joint, text, symptom.stuck, about=symptom)

    def _clear(self, watch: _Watch) -> None:
        for symptom in [s for s in watch.symptoms if s is not Symptom.SWAPPED]:
            if watch.now - watch.seen[symptom] > _GONE * 1e9:
                del watch.symptoms[symptom]
                text = f"servo {watch.servo.id}: no longer {symptom.value}"
                self._bus.note(EventKind.CLEARED, watch.joint, text, about=symptom)

    # Shutdown, heat, lost torque, missing commands: only for joints with something unusual

    def protect(self, joint: BusJoint, state: ServoState, now: int) -> None:
        """Relax or hold a joint, if its measurements call for it; `now` is monotonic, ns.

        Raises:
            PortLostError: The port was lost.
        """
        for servo in joint.servos:
            if not servo.answers:
                continue
            watch = self._watches[servo.id]
            if servo.error or servo.errors or watch.reported:
                self._judge_errors(watch, now)
            if servo.link is LinkState.INTERRUPTED and not joint.busy:
                self._check_torque(watch)
        self._judge_heat(joint)
        if self._settings.command_timeout and joint.on:
            self._judge_command(joint, state, now)

    def _judge_errors(self, watch: _Watch, now: int) -> None:
        joint, servo = watch.joint, watch.servo
        at_once = servo.model.protocol == 1 or bool(servo.error) != bool(servo.errors)
        if at_once or now - watch.errors_read >= _AGAIN * 1e9:
            watch.errors_read = now
            with suppress(CommunicationError):
                servo.errors = servo.read_errors()
        errors = servo.errors
        if isinstance(errors, ErrorBits):
            errors &= ~REFUSALS
        fatal = servo.identity is not None and errors & servo.identity.shutdown
        if fatal and not servo.faulted:
            servo.faulted = True
            self._bus.cut(joint)
            self._bus.note(
                EventKind.FAULTED,
                joint,
                f"servo {servo.id} has shut itself down: {describe_errors(errors)}; it takes "
                "no commands until recover is called",
            )
        elif errors and watch.reported != errors:
            text = f"servo {servo.id} reports: {describe_errors(errors)}"
            self._bus.note(EventKind.ALARM, joint, text, about=errors)
        watch.reported = errors

    def _ask_next(self, now: int) -> None:
        """Ask servos in turn whether they have torque.

        Another program, or a short loss of power, may have switched it. No measurement shows that
        while a joint is at rest or relaxed, or while the other servo of a joint turns it.
        """
        if now < self._ask_at or self._bus.requests.under_way:
            return
        self._turns.rotate(-1)
        watch = self._turns[0]
        self._ask_at = now + (_ASK_PAIR if len(watch.joint.servos) > 1 else _ASK)
        self._bus.requests.start(self._asking(watch))

    def _asking(self, watch: _Watch) -> Steps[None]:
        yield 0.0
        free = not (watch.joint.busy or watch.joint.stopped)
        if free and watch.servo.link is LinkState.PRESENT:
            self._check_torque(watch)

    def _check_torque(self, watch: _Watch) -> None:
        """Find a servo that has lost or kept its torque, though its joint is on or relaxed.

        One that was without power for a moment must not move to the old goal.
        """
        joint, servo = watch.joint, watch.servo
        try:
            torque = servo.get("Torque Enable", 1)
        except CommunicationError:
            return  # the next cycle asks again
        if joint.on:
            if torque != 1:
                self._bus.cut(joint)
                self._report(watch, Symptom.TORQUE_LOST, _TORQUE_LOST)
        elif not joint.resumes:  # until its other servo returns
            if torque:
                if servo.confirmed:
                    self._report(watch, Symptom.OVERRULED, _SWITCHED_ON)
                self._bus.cut(joint)
            servo.confirmed = not torque
        servo.note_torque()

    def _judge_heat(self, joint: BusJoint) -> None:
        limits = self._settings.temperature
        temperature = max(servo.temperature for servo in joint.servos if servo.answers)
        if temperature >= limits.rest:
            if joint.on:
                joint.resting = True
                self._bus.cut(joint)
                self._bus.note(
                    EventKind.RESTING,
                    joint,
                    f"{temperature:.0f} °C is too hot; it is relaxed until {limits.warn:.0f} °C",
                )
        elif joint.resting and temperature < limits.warn:
            joint.resting = False
            text = f"{temperature:.0f} °C; it takes commands again"
            self._bus.note(EventKind.COOLED, joint, text)

    def _judge_command(self, joint: BusJoint, state: ServoState, now: int) -> None:
        """Hold a moving joint when no command has come for some time."""
        since = joint.commanded_at
        if since is None or now - since < self._settings.command_timeout * 1e9:
            return
        off = joint.goal_position - state.position
        if abs(off) <= _ARRIVED * joint.configuration.resolution:
            joint.commanded_at = None
            return
        joint.hold()
        self._bus.note(
            EventKind.HELD,
            joint,
            f"no command for {self._settings.command_timeout:.2f} s; it holds its position",
        )


def _cause(watch: _Watch, values: Mapping[str, int]) -> Found:
    """Return the symptom and a sentence, if the registers show a cause."""
    servo = watch.servo
    if any(wrong_mode(servo, values)):
        return Symptom.MODE, (
            "it is not in position mode any more: another program has changed its settings; the "
            "joint is relaxed"
        )
    for name in filter(values.__contains__, _STRENGTHS):
        share = abs(values[name]) / (servo.model.control_table[name].maximum or 1)
        if share < 0.3:
            return Symptom.WEAK, f"{watch.off}: its {name} is at {share:.0%} only"
    if servo.has_watchdog and values.get("Bus Watchdog", 0) in (-1, 255):
        return Symptom.TRIPPED, (
            f"{watch.off}: its Bus Watchdog has tripped, because it received nothing for some "
            "time, and it ignores goals; it is cleared, and the joint holds its present position"
        )
    goals = watch.goals
    if goals and not min(goals) - 1 <= values["Goal Position"] <= max(goals) + 1:
        return Symptom.OVERRULED, (
            f"its goal is tick {values['Goal Position']}, not {watch.goals[-1]}: another program "
            "writes to this bus"
        )
    return None
