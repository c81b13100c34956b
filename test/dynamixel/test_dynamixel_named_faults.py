"""Faults are named: which, how soon, and none that is not there."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from itertools import cycle
from random import Random

import pytest
from simulated_device import Bench

from head_tracking.dynamixel import (
    BusEvent,
    EventKind,
    Goal,
    GoalError,
    JointConfiguration,
    PortLostError,
    ServoCalibration,
    ServoModel,
    ServoState,
    Symptom,
    servo_model,
)
from head_tracking.dynamixel.exceptions import PortMissingError
from head_tracking.dynamixel.servo import run
from head_tracking.simulation import Fault, Faults, SimulatedBus, SimulatedServo

AX, XM = servo_model("AX-12"), servo_model("XM430-W350")
STS, SCS = servo_model("STS3215"), servo_model("SCS0009")
CYCLE = 0.02  # s
HOURS = float(os.environ.get("HEAD_TRACKING_HOURS", "0.012"))
"""Simulated time without a fault: HEAD_TRACKING_HOURS=8 takes a core for half an hour."""

TOLD = 0.3  # s
SOON = 0.6  # s: some show no sign where the head turns round
PAN, TILT = "head_pan_joint", "head_tilt_joint"


class Rig:
    """A head of two servos that follows a swinging goal; noise on encoders, supply and line.

    Args:
        model: of both servos.
        seed: of all that is random.
        pair: whether two servos drive the pan joint.
        loss: share of what is sent either way that is damaged or lost.
        delay: from a goal to the begin of the motion [s].
    """

    def __init__(
        self,
        model=AX,
        seed: int = 1,
        *,
        pair: bool = False,
        loss: float = 0.0,
        delay: float = 0.03,
    ) -> None:
        self.random = Random(seed)
        ids = (1, 2, 3) if pair else (1, 2)
        self.faults = Faults(Random(seed), loss, [Fault.CORRUPT, Fault.DROP])
        servos = [
            SimulatedServo(
                each, model, position_noise=0.4, start_delay=delay, random=Random(seed + each)
            )
            for each in ids
        ]
        self.bench = Bench(SimulatedBus(servos, faults=self.faults))
        self.port = self.bench.port
        center, last = model.center, model.ticks - 1
        second = ServoCalibration(PAN, 3, center, 0, last, model) if pair else None
        self.joints = (
            JointConfiguration(
                PAN, 1, center, 0, last, controller="pan", model=model, second=second
            ),
            JointConfiguration(
                TILT, 2, center, last // 8, last - last // 8, controller="tilt", model=model
            ),
        )
        self.volts = model.nominal_voltage
        self.time = 0.0
        self.still = False
        self.states: Mapping[str, ServoState] = {}
        self.events: list[tuple[float, BusEvent]] = []
        self.each_cycle: list[Callable[[], object]] = []

    def connect(self) -> Rig:
        self.bus = self.bench.servo_bus(self.joints)
        self.bus.connect()
        return self

    def __getitem__(self, servo_id: int) -> SimulatedServo:
        return self.bench.bus[servo_id]

    def goal(self, joint: str) -> float:
        slow = 0.4 if joint == PAN else 0.31
        return 0.0 if self.still else 0.6 * math.sin(2.0 * math.pi * slow * self.time)

    def step(self) -> None:
        for name in (PAN, TILT):
            speed = 0.3 + 2.0 * abs(self.random.gauss(1.0, 0.2))
            with suppress(GoalError):  # it does not answer, or has shut itself down
                self.bus.command({name: Goal(self.goal(name), speed)})
        for servo in self.bench.bus:
            servo.supply_voltage = self.volts + self.random.gauss(0.0, 0.05)
        for what in self.each_cycle:
            what()
        begin = self.bench.now()
        reading = self.bus.step()
        self.states = reading.states
        self.events += [(self.time, event) for event in reading.events]
        rest = CYCLE - (self.bench.now() - begin) * 1e-9
        self.bench.pass_time(max(0.0, rest) if abs(rest) < CYCLE else 0.0)
        self.time += CYCLE

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / CYCLE)):
            self.step()


def told(rig: Rig, since: float, words: tuple[str, ...]) -> Iterator[float]:
    for time, event in rig.events:
        if time >= since and any(word in event.text for word in words):
            yield time


def torque_off(rig: Rig) -> None:
    rig[1].set_register("Torque Enable", 0)


def at_once(**changes: float) -> Callable[[Rig], None]:
    def change(rig: Rig) -> None:
        for name, value in changes.items():
            rig[1].set_register(name.replace("_", " "), int(value))

    return change


def _latched(rig: Rig) -> None:
    rig[1].set_register("Shutdown", 53)
    rig[1].alarms.forced = 1


def _sagging(rig: Rig) -> None:
    def sag() -> None:
        rig[1].supply_voltage = 12.0 - 5.0 * abs(rig[1].drive.speed) / 3.0

    rig.each_cycle.append(sag)


def _short_of_supply(rig: Rig) -> None:
    rig.volts = 8.5


def _frozen(rig: Rig) -> None:
    rig[1].encoder_frozen = True


def _blinks(rig: Rig) -> None:
    rig[1].power_off()
    end = rig.time + 0.25

    def back() -> None:
        if rig.time >= end and back in rig.each_cycle:
            rig.each_cycle.remove(back)
            rig[1].power_on()

    rig.each_cycle.append(back)


def _other_master(rig: Rig) -> None:
    rig.each_cycle.append(lambda: rig[1].set_register("Goal Position", 700))


def _jumps(rig: Rig) -> None:
    servo, count = rig[1], [0]
    gauss = servo._random.gauss

    class Dirty(Random):
        def gauss(self, mu: float = 0.0, sigma: float = 1.0) -> float:
            count[0] += 1
            return gauss(mu, sigma) + (120.0 if count[0] % 16 < 8 else 0.0)

    servo._random = Dirty()


def _line(rig: Rig) -> None:
    rig.faults.rate = 0.4


def _pushed(rig: Rig) -> None:
    rig[1].drive.push(3.0)


def _twin(rig: Rig) -> None:
    twin = SimulatedServo(1, rig[1].model, position=100)
    rig.bench.bus._servos = (*rig.bench.bus._servos, twin)


def _unplugged(rig: Rig) -> None:
    def gone(*_: object) -> None:
        raise PortMissingError("simulated", ())

    rig.port._open_device = gone

    def lost(*_: object, **__: object) -> None:
        rig.port.close()
        raise PortLostError("simulated", "unplugged")

    rig.port.read_group = lost


def _blocked(rig: Rig) -> None:
    rig[1].drive.impede(1.5)


def _too_hot(rig: Rig) -> None:
    rig[1].temperature = 85.0


def _overloaded(rig: Rig) -> None:
    rig[1].overload()


NAMED = {
    "supply voltage error, latched": (_latched, ("input voltage",), XM),
    "supply below what the servo needs": (
        _short_of_supply, ("supply low", "input voltage"), AX, STS,
    ),
    "supply that gives way": (_sagging, ("supply",), AX, STS),
    "torque lost": (torque_off, ("torque lost",), XM),
    "supply blinks": (_blinks, ("no answer", "lost its torque", "torque lost"), AX, STS, SCS),
    "frozen encoder": (_frozen, ("encoder frozen",), AX, XM, STS),
    "blocked shaft": (_blocked, ("blocked",), AX, XM, STS, SCS),
    "torque limit taken away": (at_once(Torque_Limit=20), ("weak",), AX, STS),
    "too hot at once": (_too_hot, ("overheating", "heats up"), AX, STS),
    "overload": (_overloaded, ("overload",), AX, XM, STS, SCS),
    "cable out": (lambda rig: rig[1].power_off(), ("no answer",), AX),
    "adapter unplugged": (_unplugged, ("unplugged",), AX),
    "second servo with its id": (_twin, ("two servos",), AX, STS),
    "disturbed line": (_line, ("line disturbed",), AX),
    "encoder jumps": (_jumps, ("encoder jumps",), AX),
    "another master": (_other_master, ("overruled",), AX, STS),
    "wheel mode": (at_once(CW_Angle_Limit=0, CCW_Angle_Limit=0), ("wrong mode",), AX),
    "operating mode": (at_once(Operating_Mode=1), ("wrong mode",), STS),
    "operating mode, X": (at_once(Operating_Mode=1), ("wrong mode", "torque lost"), XM),
    "pushed away": (_pushed, ("moves away", "blocked"), AX),
}  # fmt: skip


STANDING = ("wheel mode", "another master", "pushed away")
"""What befalls a head that stands: on one that swings, their sign depends on where it just is."""


CASES = [(name, model) for name, (_, _, *models) in NAMED.items() for model in models]


@pytest.mark.parametrize(
    ("name", "model", "phase"),
    [(*case, phase) for case, phase in zip(CASES, cycle((0.6, 0.9, 1.5)), strict=False)],
    ids=lambda each: getattr(each, "name", str(each)),
)
def test_a_fault_is_named_soon(name: str, model: ServoModel, phase: float) -> None:
    strike, words, *_ = NAMED[name]
    rig = Rig(model).connect()
    rig.still = name in STANDING
    rig.run(phase)
    assert not [event for _, event in rig.events if event.kind is EventKind.SYMPTOM]
    strike(rig)
    struck = rig.time
    rig.run(SOON)
    named = next(told(rig, struck, words), None)
    assert named is not None, [event.text for _, event in rig.events]
    print(f"{name}: named after {named - struck:.2f} s")


def drained(rig: Rig) -> None:
    def drain() -> None:
        rig.volts -= CYCLE * 0.8

    rig.each_cycle.append(drain)


def strained(rig: Rig) -> None:
    """It works against a load that it can just bear, and grows warmer by 0.05 degrees a second."""

    def warm() -> None:
        rig[1].drive.push(0.8)
        rig[1].temperature = 60.0 + 0.05 * rig.time

    rig.still = True
    rig.each_cycle.append(warm)


SLOW = {
    "battery runs down": (AX, drained, ("supply low",), 200.0),
    "heats up": (AX, strained, ("heats up",), 600.0),
}


@pytest.mark.parametrize("name", SLOW)
def test_a_slow_fault_is_named_before_the_servo_shuts_down(name: str) -> None:
    model, strike, words, longest = SLOW[name]
    rig = Rig(model).connect()
    rig.run(2.0)
    strike(rig)
    named = None
    ended = False
    while rig.time < longest and not ended:
        if name == "heats up":
            rig.bench.pass_time(0.5)  # it is hot work, and takes its time
            rig.time += 0.5
        rig.step()
        named = next(told(rig, 2.0, words), None) if named is None else named
        rests = any(event.kind is EventKind.RESTING for _, event in rig.events)
        ended = bool(rig[1].alarms.active) or rests
    assert ended, rig.states
    assert named is not None, [event.text for _, event in rig.events]
    assert rig.time - named > 1.0


@pytest.mark.parametrize(("model", "distance"), [(AX, 0.28), (STS, 2.4)], ids=["AX", "STS"])
def test_a_servo_that_is_slower_than_commanded_is_named(model, distance: float) -> None:
    rig = Rig(model).connect()
    rig.goal = lambda joint: -distance / 2  # type: ignore[method-assign]
    rig.run(2.0)
    assert not [event for _, event in rig.events if event.kind is EventKind.SYMPTOM]
    rig[1].drive.impede(0.9)
    rig.goal = lambda joint: distance / 2  # type: ignore[method-assign]
    struck = rig.time
    rig.run(0.6)
    named = next(told(rig, struck, ("slow: it turns at",)))
    assert named - struck <= 2.0 * TOLD  # a healthy servo needs TOLD to accelerate


def test_a_slipped_horn_of_a_joint_with_two_servos_is_named() -> None:
    rig = Rig(pair=True).connect()
    rig.run(2.0)
    rig[3].drive.angle += 0.12
    rig[3].drive.impede(2.0)
    struck = rig.time
    rig.run(0.5)
    named = next(told(rig, struck, ("servos disagree",)))
    assert named - struck <= TOLD


def test_one_of_two_servos_mounted_the_wrong_way_round_is_named() -> None:
    rig = Rig(pair=True).connect()

    def turn_together() -> None:
        rig[3].drive.angle = -rig[1].drive.angle

    rig.each_cycle.append(turn_together)
    rig.goal = lambda joint: 0.0  # type: ignore[method-assign]
    rig.run(1.0)
    assert not list(told(rig, 0.0, ("servos disagree",)))
    rig.goal = lambda joint: 0.5  # type: ignore[method-assign]
    started = rig.time
    rig.run(0.6)
    assert next(told(rig, started, ("mounted or calibrated the wrong way round",))) < started + 0.3


def test_swapped_servos_are_named_by_the_limits_in_their_memory() -> None:
    rig = Rig()
    last = AX.ticks - 1
    rig[1].set_register("CW Angle Limit", last // 8)
    rig[1].set_register("CCW Angle Limit", last - last // 8)
    rig.connect().run(0.1)
    assert next(told(rig, 0.0, ("swapped: its memory holds the angle limits of head_tilt",))) < TOLD


def test_a_blocked_joint_is_named_also_if_the_clock_of_the_stamps_is_set_back() -> None:
    rig = Rig()
    rig.connect()
    rig.still = True
    rig.run(1.0)
    rig[1].drive.impede(2.0)
    rig.goal = lambda joint: 0.7  # type: ignore[method-assign]
    rig.run(0.1)
    rig.bus.cycle._clock = lambda: rig.bench.now() - 3_600_000_000_000
    rig.run(0.5)
    assert list(told(rig, 1.0, ("blocked",)))


def health(rig: Rig) -> set[Symptom]:
    return set(rig.bus.statistics().servos[0].symptoms)


@pytest.mark.parametrize("model", [AX, XM, STS], ids=["AX", "X", "STS"])
def test_a_symptom_lasts_until_its_cause_is_gone(model) -> None:
    rig = Rig(model).connect()
    rig.still = True
    rig.run(1.0)
    rig[1].drive.impede(2.0)
    rig.goal = lambda joint: 0.7  # type: ignore[method-assign]
    rig.run(0.5)
    assert health(rig) == {Symptom.BLOCKED}
    rig[1].drive.impede(0.0)
    rig.run(0.3)
    run(rig.bus.recovering())
    rig.run(3.0)
    assert not health(rig)
    assert EventKind.CLEARED in [event.kind for _, event in rig.events]


@pytest.mark.parametrize(("model", "seed"), [(AX, 1), (XM, 2), (STS, 3)], ids=["AX", "X", "STS"])
def test_no_fault_is_named_where_there_is_none(model, seed: int) -> None:
    """Swings and stands in turns, with noise and lost replies."""
    rig = Rig(model, seed, loss=0.001).connect()
    while rig.time < HOURS * 3600.0 / 3.0:
        rig.still = False
        rig.run(12.0)
        rig.still = True
        rig.run(3.0)
    texts = [event.text for _, event in rig.events if event.kind is not EventKind.TORQUE_ON]
    assert not texts


def test_a_joint_that_slows_down_and_turns_round_meets_no_obstacle() -> None:
    """As a tracker does it: the goal leads, slower and slower, then it is on the other side."""
    rig = Rig(AX, 5).connect()
    rig.each_cycle.append(lambda: rig.bus.command({PAN: turning(rig)}))
    rig.run(12.0)
    texts = [event.text for _, event in rig.events if event.kind is not EventKind.TORQUE_ON]
    assert not texts


@pytest.mark.parametrize(
    ("model", "speed", "delay"),
    [(AX, 0.05, 0.08), (XM, 0.4, 0.03), (STS, 0.05, 0.03), (XM, 0.05, 0.08)],
    ids=["AX", "X fast", "STS", "X slow"],
)
def test_a_joint_that_begins_slowly_meets_no_obstacle(model, speed: float, delay: float) -> None:
    """It rests at its goal, then the goal leads, to one side and to the other in turns."""
    rig = Rig(model, 3, delay=delay).connect()
    rig.still = True
    rig.run(0.5)

    def lead() -> None:
        side = (0.0, 1.0, 0.0, -1.0)[int(rig.time) % 4]
        rig.bus.command({PAN: Goal(rig.states[PAN].position + 0.09 * side, speed)})

    rig.each_cycle.append(lead)
    rig.run(5.0)
    texts = [event.text for _, event in rig.events if event.kind is not EventKind.TORQUE_ON]
    assert not texts


def turning(rig: Rig) -> Goal:
    phase = rig.time % 1.0
    side = 1.0 if rig.time % 2.0 < 1.0 else -1.0
    speed = 1.5 if phase > 0.06 else 0.5
    if phase > 0.5:
        speed = max(0.24, 1.2 * (1.0 - phase))
    here = rig.states[PAN].position if PAN in rig.states else 0.0
    return Goal(here + side * (0.07 + 0.16 * speed), speed)
