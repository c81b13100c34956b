"""Names what is wrong with a servo from what it says in each cycle, and what became of commands.

A healthy servo is never called sick: each symptom needs a contradiction that lasts, between what
was asked, what is measured, and what the servo says of itself. Only where one is suspected, a few
registers are read that tell the cause. Thresholds are ours, tried against the simulator: see
test/dynamixel/test_dynamixel_named_faults.py.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Final

from head_tracking.dynamixel.configuration import BusSettings
from head_tracking.dynamixel.exceptions import CommunicationError
from head_tracking.dynamixel.joint import Joint
from head_tracking.dynamixel.requests import Steps
from head_tracking.dynamixel.servo import LinkState, Servo, ServoIdentity
from head_tracking.dynamixel.state import EventKind, Symptom

_NS: Final = 1_000_000_000
_STUCK: Final = 0.12  # s far from a goal without progress; a servo starts within 0.05 s
_TURNS: Final = 0.1  # s that it may take to slow down and start the other way
_STANDSTILL: Final = 0.02  # s of a cycle that count: in a late one the goal may have come late
_AWAY: Final = 120_000_000  # ns of motion away from it, without slowing down
_LONG_AWAY: Final = 200_000_000  # ns of it in any case: a heavy head has turned round by then
_GRACE: Final = 100_000_000  # ns until a servo has gathered speed
_PACE: Final = 160_000_000  # ns in which its speed is measured
_FROZEN: Final = 120_000_000  # ns of speed without a change of position
_LASTING: Final = 60_000_000  # ns for which a supply is low, or two servos disagree
_GONE: Final = _NS  # ns without a symptom until it counts as gone
_AGAIN: Final = _NS  # ns between two examinations of a servo
_OFF: Final = 0.06  # rad from the goal
_YIELDS: Final = 0.12  # rad by which a servo may give way to the weight that it holds
_STRAINED: Final = 0.6  # of full torque: more than it may hold for long
_FAR: Final = 0.3  # rad: it moves at its full speed over most of that
_PROGRESS: Final = 0.012  # rad
_MOVES: Final = 0.3  # rad/s
_COOLER: Final = 3.0  # °C
_SLOW: Final = 0.35  # of the speed that was asked for
_DRIVES: Final = 0.15  # of full torque
_APART: Final = 0.06  # rad between two servos of a joint
_LOW: Final = 0.8  # of the voltage that a model is made for
_SAG: Final = 0.1  # likewise
_LONGEST_READ: Final = 64  # bytes
_WARM: Final = 8.0  # °C below the limit at which a servo shuts itself down
_FAILURES: Final = (4, 300_000_000)  # failed transactions with a servo, within ns
_ARRIVED: Final = 5.0  # ticks
_CAUSES: Final = (
    "Torque Enable", "Goal Position", "Torque Limit", "Max Torque", "Operating Mode",
    "Bus Watchdog", "Control Mode",
)  # fmt: skip
"""Registers that tell why a servo does not follow, besides its position limits."""


class _Watch:
    """What is remembered of a servo from cycle to cycle."""

    __slots__ = (
        "apart_since", "away_from", "away_since", "calm", "examined", "failures", "frozen_since",
        "frozen_ticks", "goals", "identity", "jumped", "low_since", "lowest", "outcome", "owed",
        "pace_begin", "pace_since", "position", "rest_position", "rest_since", "sag_since", "seen",
        "side", "stamp", "symptoms", "target", "target_since", "usual_voltage", "wanted", "warm",
    )  # fmt: skip

    def __init__(self) -> None:
        self.symptoms: dict[Symptom, str] = {}
        self.seen: dict[Symptom, int] = {}
        self.stamp = self.rest_since = self.away_since = self.pace_since = 0
        self.frozen_since = self.low_since = self.sag_since = self.apart_since = 0
        self.target_since = 0
        self.examined = -_AGAIN
        self.side = 0.0
        self.position = self.rest_position = self.away_from = self.pace_begin = 0.0
        self.frozen_ticks = 0
        self.jumped = 0.0
        self.usual_voltage = self.lowest = 0.0
        self.warm = math.inf
        self.calm = 0
        self.owed = 0.0
        self.goals: deque[int] = deque(maxlen=5)
        self.wanted = 0.0
        self.failures: list[int] = []
        self.identity: ServoIdentity | None = None
        self.target: tuple[int, ...] = ()
        self.outcome = ""


class Diagnosis:
    """Looks at all servos once a cycle, after they were read.

    Args:
        note: Takes an event: its kind, the joint, a text, whether the joint is stuck.
        cut: Relaxes a joint at once, and makes sure of it in later cycles.
        enqueue: Takes steps before goals are written, in this cycle and the next ones.
        clear_watchdog: Holds a joint where it is, with its watchdog armed anew.
        settings: Temperatures.
    """

    def __init__(
        self,
        note: Callable[[EventKind, Joint, str, bool], None],
        cut: Callable[[Joint], None],
        enqueue: Callable[[Steps[None]], object],
        clear_watchdog: Callable[[Joint], None],
        settings: BusSettings,
    ) -> None:
        self._note, self._cut, self._enqueue = note, cut, enqueue
        self._clear_watchdog = clear_watchdog
        self._warm = settings.warm
        self._watches: dict[int, _Watch] = {}

    def of(self, servo_id: int) -> tuple[Mapping[Symptom, str], str]:
        """What is wrong with a servo now, a sentence each; and what became of its last goal."""
        watch = self._watches.get(servo_id)
        return ({}, "") if watch is None else (dict(watch.symptoms), watch.outcome)

    def look(self, joints: Iterable[Joint], now: int) -> None:
        """Look at what was read in this cycle; `now` is monotonic, ns."""
        watches = self._watches
        for joint in joints:
            if joint.stopped:
                continue
            if len(joint.servos) > 1:
                self._compare(joint, now)
            for index, servo in enumerate(joint.servos):
                watch = watches.get(servo.id) or self._begin(servo)
                if watch.symptoms:
                    self._clear(joint, servo, watch, now)
                if joint.goal_ticks:
                    watch.goals.append(joint.goal_ticks[index])  # also if no answer came meanwhile
                counters = servo.counters
                failures = counters.timeouts + counters.corrupt
                if failures != watch.calm:
                    self._count(joint, servo, watch, failures, now)
                if servo.stamp == watch.stamp or servo.link is not LinkState.PRESENT:
                    watch.rest_since = watch.away_since = watch.pace_since = now
                    watch.frozen_since = now
                    watch.owed = 0.0
                    if servo.lost and watch.target:
                        self._end(joint, watch, "not reached: the servo does not answer")
                    continue
                model = servo.model
                tick = abs(servo.scale)
                position, velocity = servo.position, servo.velocity
                elapsed = (servo.stamp - watch.stamp) * 1e-9
                step = position - watch.position
                if model.endless:
                    step = math.remainder(step, model.ticks * tick)
                if watch.identity is not servo.identity:
                    self._know(servo, watch)
                    watch.frozen_since = now
                elif joint.on and 0.0 < elapsed < 0.1:
                    far = 2.0 * model.no_load_speed * elapsed + 8.0 * tick
                    if watch.jumped and abs(step) <= far:  # it stays where it has jumped to
                        self._tell(joint, servo, watch, Symptom.JUMP, now,
                                   f"its position jumped by {watch.jumped:+.2f} rad in a cycle: "
                                   "a dirty or loose encoder, or teeth of its gear")  # fmt: skip
                        watch.jumped = 0.0
                    elif abs(step) > far:
                        watch.jumped = step
                watch.stamp, watch.position = servo.stamp, position
                end = servo.ticks in (
                    0,
                    model.ticks - 1,
                )  # it may turn on beyond what it can measure
                if servo.ticks != watch.frozen_ticks or abs(velocity) < _MOVES or end:
                    watch.frozen_ticks, watch.frozen_since = servo.ticks, now
                elif now - watch.frozen_since >= max(
                    _FROZEN, round(10.0 * tick / abs(velocity) * _NS)
                ):
                    self._tell(joint, servo, watch, Symptom.FROZEN, now,
                               f"it says that it turns at {velocity:+.1f} rad/s, but its position "
                               f"stands at {position:.3f} rad: its encoder is frozen")  # fmt: skip
                volts = servo.voltage
                usual = watch.usual_voltage
                if volts >= watch.lowest and volts >= usual - _SAG * model.nominal_voltage:
                    watch.low_since = watch.sag_since = now
                else:
                    self._look_at_supply(joint, servo, watch, now)
                watch.usual_voltage = usual + (0.1 if volts > usual else 0.001) * (volts - usual)
                if servo.temperature >= watch.warm:
                    self._look_at_heat(joint, servo, watch, now)
                if not joint.on or joint.busy or not joint.goal_ticks:
                    watch.rest_since = watch.away_since = watch.pace_since = now
                    watch.rest_position, watch.owed = position, 0.0
                    if watch.target and not joint.busy:
                        self._end(joint, watch, f"not reached: {joint.torque.value}")
                    continue
                goal = (joint.goal_ticks[index] - servo.zero) * servo.scale
                error = goal - position
                off = abs(error)
                if watch.target != joint.goal_ticks:
                    watch.target, watch.target_since, watch.outcome = (
                        joint.goal_ticks,
                        now,
                        "under way",
                    )
                near = _ARRIVED * tick
                # Away
                if velocity * error >= 0.0 or abs(velocity) < _MOVES or off < 0.1:
                    watch.away_since, watch.away_from = now, abs(velocity)
                elif now - watch.away_since >= (
                    _AWAY if abs(velocity) >= 0.8 * watch.away_from else _LONG_AWAY
                ):
                    self._suspect(joint, servo, watch, Symptom.AWAY, now)
                # Slow
                ahead = velocity * error > 0.0
                asked = joint.default_speed if joint.goal_speed is None else joint.goal_speed
                if off < _FAR or not ahead or watch.wanted * error < 0.0 or asked < _MOVES:
                    watch.pace_since, watch.pace_begin, watch.wanted = now, position, error
                elif now - watch.pace_since < _GRACE:
                    watch.pace_begin = position
                elif now - watch.pace_since >= _GRACE + _PACE:
                    expected = min(asked, 0.9 * self._fastest(servo)) * _PACE * 1e-9
                    moved = abs(position - watch.pace_begin)
                    if moved < _SLOW * expected:
                        self._suspect(joint, servo, watch, Symptom.SLOW, now)
                    watch.pace_since, watch.pace_begin = now - _GRACE, position
                # Stuck
                turns = error * watch.side < 0.0  # the goal has moved to the other side of it
                watch.side = error
                if turns or abs(position - watch.rest_position) >= max(_PROGRESS, 3.0 * tick):
                    watch.rest_since, watch.rest_position = now, position
                    watch.owed = -_TURNS if turns else 0.0
                patience = max(_STUCK, 8.0 * tick / max(asked, 1e-3))
                if off > _YIELDS or (off > _OFF and not _DRIVES <= abs(servo.load) <= _STRAINED):
                    watch.owed += min(elapsed, _STANDSTILL)
                    if watch.owed >= patience:
                        self._suspect(joint, servo, watch, Symptom.BLOCKED, now)
                elif off <= near:
                    if abs(velocity) < _MOVES:
                        watch.outcome = "arrived"
                elif watch.outcome == "under way" and (
                    now - max(watch.rest_since, watch.target_since) >= 2.0 * patience * _NS
                ):
                    watch.outcome = f"missed by {off:.3f} rad: it stands"

    def _begin(self, servo: Servo) -> _Watch:
        return self._watches.setdefault(servo.id, _Watch())

    def _know(self, servo: Servo, watch: _Watch) -> None:
        """Take over what a servo says of itself when it is found."""
        watch.identity = identity = servo.identity
        watch.usual_voltage = servo.voltage
        if identity is not None:
            nominal = servo.model.nominal_voltage
            watch.lowest = max(_LOW * nominal, identity.lowest_voltage + 0.5)
            watch.warm = self._limit(identity)

    def _limit(self, identity: ServoIdentity) -> float:
        return min(self._warm, identity.temperature_limit - _WARM)

    def _fastest(self, servo: Servo) -> float:
        model = servo.model
        share = servo.voltage / model.nominal_voltage if servo.voltage else 1.0
        return model.no_load_speed * min(1.0, share)

    def _suspect(
        self, joint: Joint, servo: Servo, watch: _Watch, suspicion: Symptom, now: int
    ) -> None:
        """Ask a servo why, unless that is known and it is still the same."""
        for known in watch.symptoms:
            if known not in (Symptom.SUPPLY, Symptom.SAG, Symptom.WARM, Symptom.LINE):
                watch.seen[known] = now
        if now - watch.examined < _AGAIN:
            return
        watch.examined = now
        self._enqueue(self._examining(joint, servo, watch, suspicion, now))

    def _examining(
        self, joint: Joint, servo: Servo, watch: _Watch, suspicion: Symptom, now: int
    ) -> Steps[None]:
        for last in (False, True):
            values: dict[str, int] = {}
            try:
                wanted = (*_CAUSES, *servo.model.position_limits)
                for block in servo.model.control_table.spans(_LONGEST_READ, wanted):
                    names = [register.name for register in block.registers]
                    values.update(zip(names, servo.read(block, 2), strict=True))
                    yield 0.0
            except CommunicationError:
                watch.examined = -_AGAIN
                return
            if not joint.on or joint.busy:
                return  # somebody has relaxed it meanwhile
            symptom, text = self._cause(joint, servo, watch, values, suspicion)
            if symptom is not Symptom.OVERRULED or last:
                break  # a goal that went out while the bus was held up is not somebody else's
        self._tell(joint, servo, watch, symptom, now, text)
        if symptom in (Symptom.TORQUE_LOST, Symptom.MODE):
            self._cut(joint)
        elif symptom is Symptom.TRIPPED:
            self._clear_watchdog(joint)

    def _cause(
        self,
        joint: Joint,
        servo: Servo,
        watch: _Watch,
        values: Mapping[str, int],
        suspicion: Symptom,
    ) -> tuple[Symptom, str]:
        """The symptom that the registers give, and a sentence."""
        goal = joint.goal_position
        off = f"it stands {abs(goal - servo.position):.2f} rad from its goal"
        if not values["Torque Enable"]:
            return Symptom.TORQUE_LOST, (
                "its torque is off, though nobody here has switched it off: its supply, or another "
                "program; the joint is relaxed until the next command"
            )
        mode = values.get("Operating Mode", 3), values.get("Control Mode", 2)
        limits = [values[name] for name in servo.model.position_limits]
        turns = servo.model.protocol == 1 and limits[0] == limits[1]
        if mode != (3, 2) or turns:
            return Symptom.MODE, (
                "it is not in position mode any more: somebody has changed its settings; the joint "
                "is relaxed"
            )
        limit, most = values.get("Torque Limit", 1), values.get("Max Torque", 1)
        if "Max Torque" in values and limit < 0.3 * most:
            share = limit / servo.model.load_maximum
            return Symptom.WEAK, f"{off}: its Torque Limit is at {share:.0%} only"
        if servo.watched and values.get("Bus Watchdog", 0) in (-1, 255):
            return Symptom.TRIPPED, (
                f"{off}: its Bus Watchdog has tripped, because it heard nothing for some time, and "
                "it ignores goals; it is cleared, and the joint holds where it is"
            )
        if watch.goals and all(abs(values["Goal Position"] - each) > 1 for each in watch.goals):
            return Symptom.OVERRULED, (
                f"it goes to tick {values['Goal Position']}, not {watch.goals[-1]}: another "
                "program writes to this bus"
            )
        if suspicion is Symptom.AWAY:
            return Symptom.AWAY, (
                f"it turns away from its goal at {servo.velocity:+.1f} rad/s: something pushes it, "
                "or its motor does not obey"
            )
        if suspicion is Symptom.SLOW:
            return Symptom.SLOW, (
                f"it turns at {abs(servo.velocity):.1f} rad/s, far less than was asked "
                f"for, at {servo.voltage:.1f} V and {abs(servo.load):.0%} of its torque: friction, "
                "load, or a weak supply"
            )
        if abs(servo.load) < _DRIVES:
            return Symptom.IDLE, f"{off} and does not drive, with torque on: motor or gear"
        return Symptom.BLOCKED, (
            f"{off} and drives with {abs(servo.load):.0%} of its torque: something is in its way, "
            "an end stop (has a horn slipped?), or its encoder stands"
        )

    def _look_at_supply(self, joint: Joint, servo: Servo, watch: _Watch, now: int) -> None:
        volts, nominal = servo.voltage, servo.model.nominal_voltage
        if volts >= watch.lowest:
            watch.low_since = now
        elif now - watch.low_since >= _LASTING:
            self._tell(joint, servo, watch, Symptom.SUPPLY, now,
                       f"its supply is down to {volts:.1f} V, of {nominal:.1f} V that it is made "
                       "for: charge the battery, or take a stronger supply")  # fmt: skip
        if watch.usual_voltage - volts < _SAG * nominal:
            watch.sag_since = now
        elif now - watch.sag_since >= _LASTING:
            self._tell(joint, servo, watch, Symptom.SAG, now,
                       f"its supply falls from {watch.usual_voltage:.1f} to {volts:.1f} V under "
                       "load: too weak, or a thin cable or bad plug")  # fmt: skip

    def _look_at_heat(self, joint: Joint, servo: Servo, watch: _Watch, now: int) -> None:
        identity = servo.identity
        if identity is None:
            return
        watch.warm = self._limit(identity) - _COOLER
        self._tell(joint, servo, watch, Symptom.WARM, now,
                   f"it is at {servo.temperature:.0f} °C; at {identity.temperature_limit:.0f} °C "
                   "it shuts itself down: what does it work against?")  # fmt: skip

    def _compare(self, joint: Joint, now: int) -> None:
        first, second = joint.servos
        watch = self._begin(first)
        slack = _APART + 0.02 * abs(first.velocity)
        unread = not (first.answers and second.answers)
        if unread or joint.busy or abs(first.position - second.position) < slack:
            watch.apart_since = now
        elif now - watch.apart_since >= _LASTING:
            apart = abs(first.position - second.position)
            self._tell(joint, first, watch, Symptom.APART, now,
                       f"it and servo {second.id}, which turn one joint, are {apart:.2f} rad "
                       "apart: a horn has slipped, or one is mounted or calibrated the wrong way "
                       "round")  # fmt: skip

    def _count(self, joint: Joint, servo: Servo, watch: _Watch, failures: int, now: int) -> None:
        """Take note of failed transactions of the last cycle."""
        most, within = _FAILURES
        watch.failures += [now] * min(most, failures - watch.calm)
        watch.calm = failures
        watch.failures = [when for when in watch.failures if now - when <= within]
        if len(watch.failures) >= most and not servo.failed_cycles:
            self._tell(joint, servo, watch, Symptom.LINE, now,
                       f"{len(watch.failures)} transactions failed within {within / _NS:.1f} s, "
                       "though it answers: plugs, cables, ground, or two servos with one "
                       "id")  # fmt: skip

    def swapped(self, joints: Iterable[Joint]) -> None:
        """Tell of servos whose own angle limits are those of another joint's, not their own's."""
        servos = [(joint, servo) for joint in joints for servo in joint.servos]
        for joint, servo in servos:
            if servo.identity is None:
                continue
            own = servo.identity.own_range
            wanted = servo.calibration.tick_range
            if own in (wanted, (0, servo.model.ticks - 1)):
                continue
            meant = [
                other.name
                for other, each in servos
                if each is not servo and each.calibration.tick_range == own
            ]
            if meant:
                watch = self._begin(servo)
                self._tell(joint, servo, watch, Symptom.SWAPPED, 0,
                           f"its memory holds the angle limits of {meant[0]}: have two servos been "
                           "swapped?")  # fmt: skip

    def _tell(
        self, joint: Joint, servo: Servo, watch: _Watch, symptom: Symptom, now: int, text: str
    ) -> None:
        watch.seen[symptom] = now
        if symptom in watch.symptoms:
            return
        watch.symptoms[symptom] = text
        kind = EventKind.TORQUE_LOST if symptom is Symptom.TORQUE_LOST else EventKind.SYMPTOM
        self._note(kind, joint, f"servo {servo.id}: {symptom.value}: {text}", symptom.stuck)
        if watch.outcome == "under way" and symptom is not Symptom.WARM:
            goal = joint.goal_position
            watch.outcome = f"missed by {abs(goal - servo.position):.3f} rad: {symptom.value}"

    def _clear(self, joint: Joint, servo: Servo, watch: _Watch, now: int) -> None:
        for symptom in [s for s in watch.symptoms if s is not Symptom.SWAPPED]:
            if now - watch.seen[symptom] > _GONE:
                del watch.symptoms[symptom]
                if symptom is Symptom.WARM and watch.identity is not None:
                    watch.warm = self._limit(watch.identity)
                text = f"servo {servo.id}: no longer {symptom.value}"
                self._note(EventKind.CLEARED, joint, text, False)

    def _end(self, joint: Joint, watch: _Watch, why: str) -> None:
        """A goal has been dropped."""
        watch.target = ()
        if watch.outcome in ("under way", ""):
            watch.outcome = why
