"""Faults are named: which, how soon, and none that is not there."""

import math
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from itertools import cycle
from random import Random
from typing import Any

import pytest
from simulated_device import PERIOD, Rig, joint_of

from head_tracking.dynamixel import (
    BusEvent,
    BusReading,
    EventKind,
    Goal,
    GoalError,
    ServoCalibration,
    ServoModel,
    Symptom,
    servo_model,
)
from head_tracking.simulation import Fault, Faults, SimulatedBus, SimulatedServo

AX, XM = servo_model("AX-12"), servo_model("XM430-W350")
STS, SCS = servo_model("STS3215"), servo_model("SCS0009")
HOURS = float(os.environ.get("HEAD_TRACKING_HOURS", "0.012"))
"""Simulated time without a fault: HEAD_TRACKING_HOURS=8 takes a core for half an hour."""

TOLD = 0.3  # s
SOON = 0.6  # s: some show no sign where the head turns round
PAN, TILT = "head_pan_joint", "head_tilt_joint"
Fact = EventKind | Symptom


class Noise(Random):
    """The noise of an encoder, which may jump to and fro."""

    jumps = False
    drawn = 0

    def gauss(self, mu: float = 0.0, sigma: float = 1.0) -> float:
        self.drawn += 1
        return super().gauss(mu, sigma) + (120.0 if self.jumps and self.drawn % 16 < 8 else 0.0)


class Head(Rig):
    """A head that follows a swinging goal; noise on encoders, supply and line."""

    def __init__(
        self,
        model: ServoModel = AX,  # of its servos
        seed: int = 1,  # of all that is random
        *,
        pair: bool = False,  # whether two servos drive the pan joint
        loss: float = 0.0,  # share of what is sent either way that is damaged or lost
        delay: float = 0.03,  # from a goal to the begin of the motion [s]
        **options: Any,  # see `Rig`
    ) -> None:
        self.random = Random(seed)
        self.faults = Faults(Random(seed), loss, [Fault.CORRUPT, Fault.DROP])
        self.noise = {each: Noise(seed + each) for each in ((1, 2, 3) if pair else (1, 2))}
        servos = [
            SimulatedServo(each, model, position_noise=0.4, start_delay=delay, random=noise)
            for each, noise in self.noise.items()
        ]
        last = model.ticks - 1
        second = ServoCalibration(PAN, 3, model.center, 0, last, model) if pair else None
        pan, tilt = joint_of(1, model), joint_of(2, model, last // 8, last - last // 8)
        joints = (replace(pan, joint_name=PAN, second=second), replace(tilt, joint_name=TILT))
        self.volts = model.nominal_voltage
        self.still = False
        self.told: list[tuple[float, BusEvent, set[Fact]]] = []
        self.each_cycle: list[Callable[[], object]] = []
        super().__init__(SimulatedBus(servos, faults=self.faults), joints=joints, **options)

    def __getitem__(self, servo_id: int) -> SimulatedServo:
        return self.bench[servo_id]

    @property
    def time(self) -> float:
        return self.bench.now() * 1e-9 - 1.0

    def goal(self, joint: str) -> float:
        slow = 0.4 if joint == PAN else 0.31
        return 0.0 if self.still else 0.6 * math.sin(2.0 * math.pi * slow * self.time)

    def step(self, count: int = 1) -> BusReading:
        for _ in range(count):
            for name in (PAN, TILT):
                speed = 0.3 + 2.0 * abs(self.random.gauss(1.0, 0.2))
                with suppress(GoalError):  # it does not answer, or has shut itself down
                    self.bus.command({name: Goal(self.goal(name), speed)})
            for servo in self.servos:
                servo.supply_voltage = self.volts + self.random.gauss(0.0, 0.05)
            for what in self.each_cycle:
                what()
            for event in super().step().events:
                facts: set[Fact] = {event.kind}
                if event.kind is EventKind.SYMPTOM:
                    facts |= {s for each in self.bus.statistics().servos for s in each.symptoms}
                self.told.append((self.time, event, facts))
        return self.reading

    def run(self, seconds: float) -> None:
        self.step(round(seconds / PERIOD))

    def named(self, since: float, *facts: Fact, cause: str = "") -> float | None:
        """Return when one of these facts was first told, with a word of its cause."""
        found = (t for t, e, told in self.told if cause in e.text and told & {*facts})
        return next((t for t in found if t >= since), None)

    @property
    def complaints(self) -> list[str]:
        """What was told, besides that torque came on."""
        return [event.text for _, event, _ in self.told if event.kind is not EventKind.TORQUE_ON]


def registers(**changes: int) -> Callable[[Head], None]:
    def change(head: Head) -> None:
        for name, value in changes.items():
            head[1].set_register(name.replace("_", " "), value)

    return change


def latch(head: Head) -> None:
    head[1].set_register("Shutdown", 53)
    head[1].alarms.forced = 1


def sag(head: Head) -> None:
    def load_supply() -> None:
        head[1].supply_voltage = 12.0 - 5.0 * abs(head[1].drive.speed) / 3.0

    head.each_cycle.append(load_supply)


def blink(head: Head) -> None:
    head[1].power_off()
    end = head.time + 0.25

    def back() -> None:
        if head.time >= end and back in head.each_cycle:
            head.each_cycle.remove(back)
            head[1].power_on()

    head.each_cycle.append(back)


def overrule(head: Head) -> None:
    head.each_cycle.append(lambda: head[1].set_register("Goal Position", 700))


def double(head: Head) -> None:
    twin = SimulatedServo(1, head[1].model, position=100)
    head.bench.bus._servos = (*head.bench.bus._servos, twin)


TORQUE_LOST = (Symptom.TORQUE_LOST, EventKind.TORQUE_LOST)
OVERHEATING = (Symptom.WARM, EventKind.ALARM, EventKind.FAULTED)
NAMED = {
    "supply voltage error, latched": (latch, (EventKind.ALARM,), XM),
    "supply below what the servo needs": (
        lambda head: setattr(head, "volts", 8.5), (Symptom.SUPPLY, EventKind.ALARM), AX, STS,
    ),
    "supply that gives way": (sag, (Symptom.SAG, Symptom.SUPPLY), AX, STS),
    "torque lost": (registers(Torque_Enable=0), TORQUE_LOST, XM),
    "supply blinks": (blink, (EventKind.LOST, *TORQUE_LOST), AX, STS, SCS),
    "frozen encoder": (
        lambda head: setattr(head[1], "encoder_frozen", True), (Symptom.FROZEN,), AX, XM, STS,
    ),
    "blocked shaft": (lambda head: head[1].drive.impede(1.5), (Symptom.BLOCKED,), AX, XM, STS, SCS),
    "torque limit taken away": (registers(Torque_Limit=20), (Symptom.WEAK,), AX, STS),
    "no torque from the factory on": (
        registers(Max_Torque=0, Torque_Limit=0), (Symptom.WEAK,), AX, STS,
    ),
    "torque limit taken away, X": (registers(Goal_PWM=20), (Symptom.WEAK,), XM),
    "too hot at once": (
        lambda head: setattr(head[1], "temperature", 85.0), OVERHEATING, AX, STS,
    ),
    "overload": (lambda head: head[1].overload(), (EventKind.FAULTED,), AX, XM, STS, SCS),
    "cable out": (lambda head: head[1].power_off(), (EventKind.LOST,), AX),
    "adapter unplugged": (
        lambda head: setattr(head.bench.line, "plugged", False), (EventKind.PORT_LOST,), AX,
    ),
    "second servo with its id": (double, (Symptom.LINE, EventKind.LOST), AX, STS),
    "disturbed line": (lambda head: setattr(head.faults, "rate", 0.4), (Symptom.LINE,), AX),
    "encoder jumps": (
        lambda head: setattr(head.noise[1], "jumps", True), (Symptom.JUMP,), AX,
    ),
    "another master": (overrule, (Symptom.OVERRULED,), AX, STS),
    "wheel mode": (registers(CW_Angle_Limit=0, CCW_Angle_Limit=0), (Symptom.MODE,), AX),
    "operating mode": (registers(Operating_Mode=1), (Symptom.MODE,), STS),
    "operating mode, X": (registers(Operating_Mode=1), (Symptom.MODE, *TORQUE_LOST), XM),
    "pushed away": (lambda head: head[1].drive.push(3.0), (Symptom.AWAY, Symptom.BLOCKED), AX),
}  # fmt: skip


STANDING = ("wheel mode", "another master", "pushed away")
"""What befalls a head that stands: on one that swings, their sign depends on where it just is."""


CASES = [(name, model) for name, (_, _, *models) in NAMED.items() for model in models]


@pytest.mark.parametrize(
    ("name", "model", "phase"),
    [(*case, phase) for case, phase in zip(CASES, cycle((0.6, 0.9, 1.5)), strict=False)],
    ids=lambda each: getattr(each, "name", str(each)),
)
def test_a_fault_is_named_soon(name, model, phase):
    strike, facts, *_ = NAMED[name]
    head = Head(model)
    head.still = name in STANDING
    head.run(phase)
    assert not head.complaints
    strike(head)
    struck = head.time
    head.run(SOON)
    named = head.named(struck, *facts, cause="two servos" if strike is double else "")
    assert named is not None, head.complaints
    print(f"{name}: named after {named - struck:.2f} s")


def drain(head: Head) -> None:
    head.volts -= PERIOD * 0.8


def strain(head: Head) -> None:
    """It stands with a load that it can just bear, and grows warmer by 0.05 degrees a second."""
    head.still = True
    head[1].drive.push(0.8)
    head[1].temperature = 60.0 + 0.05 * head.time
    head.bench.pass_time(0.5)  # it is hot work, and takes its time


@pytest.mark.parametrize(
    ("strike", "symptom", "longest"),
    [(drain, Symptom.SUPPLY, 200.0), (strain, Symptom.WARM, 600.0)],
)
def test_a_slow_fault_is_named_before_the_servo_shuts_down(strike, symptom, longest):
    head = Head()
    head.run(2.0)
    head.each_cycle.append(lambda: strike(head))
    while not (head[1].alarms.active or EventKind.RESTING in head.kinds):
        head.step()
        assert head.time < longest
    named = head.named(2.0, symptom)
    assert named is not None and head.time - named > 1.0, head.complaints


def test_a_slipped_horn_of_a_joint_with_two_servos_is_named():
    head = Head(pair=True)
    head.run(2.0)
    head[3].drive.angle += 0.12
    head[3].drive.impede(2.0)
    struck = head.time
    head.run(TOLD)
    assert head.named(struck, Symptom.APART)


def test_one_of_two_servos_mounted_the_wrong_way_round_is_named():
    head = Head(pair=True)

    def turn_together():
        head[3].drive.angle = -head[1].drive.angle

    head.each_cycle.append(turn_together)
    head.goal = lambda joint: 0.0
    head.run(1.0)
    assert not head.named(0.0, Symptom.APART)
    head.goal = lambda joint: 0.5
    head.run(TOLD)
    assert head.named(0.0, Symptom.APART, cause="wrong way")


def test_swapped_servos_are_named_by_the_limits_in_their_memory():
    head = Head(connect=False)
    last = AX.ticks - 1
    registers(CW_Angle_Limit=last // 8, CCW_Angle_Limit=last - last // 8)(head)
    head.bus.connect()
    head.step()
    assert head.named(0.0, Symptom.SWAPPED, cause="head_tilt")


# No fault


@pytest.mark.parametrize(
    ("model", "seed", "tick"),
    [(AX, 1, 1), (XM, 2, 1), (STS, 3, 1), (XM, 4, 33_000_000)],
    ids=["AX", "X", "STS", "X, /clock at 30 Hz"],
)
def test_no_fault_is_named_where_there_is_none(model, seed, tick):
    """Swings and stands in turns, with noise and lost replies."""
    head = Head(model, seed, loss=0.001, tick=tick)
    while head.time < HOURS * 3600.0 / 3.0:
        head.still = False
        head.run(12.0)
        head.still = True
        head.run(3.0)
    assert not head.complaints


def turn_round(head: Head) -> Goal:
    """As a tracker does it: the goal leads, slower and slower, then it is on the other side."""
    phase = head.time % 1.0
    side = 1.0 if head.time % 2.0 < 1.0 else -1.0
    speed = 1.5 if phase > 0.06 else 0.5
    if phase > 0.5:
        speed = max(0.24, 1.2 * (1.0 - phase))
    return Goal(head.reading.states[PAN].position + side * (0.07 + 0.16 * speed), speed)


def begin_slowly(speed: float) -> Callable[[Head], Goal]:
    """It rests at its goal, then the goal leads, to one side and to the other in turns."""

    def goal(head: Head) -> Goal:
        side = (0.0, 1.0, 0.0, -1.0)[int(head.time) % 4]
        return Goal(head.reading.states[PAN].position + 0.09 * side, speed)

    return goal


def hurry(head: Head) -> Goal:
    """Its goal is far, and its speed rises, as when a slow search has found the target."""
    side = 1.0 if head.time % 8.0 < 4.0 else -1.0
    return Goal(2.0 * side, 0.3 if head.time % 1.7 < 1.4 else 4.0)


def limited(head: Head) -> Goal:
    """As before, but `max_speed` is low, since a while after the start."""
    if head.time > 1.0:
        head.bus.joint(PAN).reconfigure(max_speed=0.05)
    return hurry(head)


@pytest.mark.parametrize(
    ("model", "goal", "delay"),
    [
        (AX, turn_round, 0.03),
        (AX, limited, 0.03),
        (AX, hurry, 0.03),
        (XM, hurry, 0.03),
        (STS, hurry, 0.03),
        (AX, begin_slowly(0.05), 0.08),
        (XM, begin_slowly(0.4), 0.03),
        (STS, begin_slowly(0.05), 0.03),
        (XM, begin_slowly(0.05), 0.08),
    ],
    ids=[
        "turns round",
        "limited",
        "AX hurries",
        "X hurries",
        "STS hurries",
        "AX",
        "X fast",
        "STS",
        "X slow",
    ],
)
def test_a_joint_that_begins_slowly_hurries_or_turns_round_meets_no_obstacle(model, goal, delay):
    head = Head(model, 3, delay=delay)
    head.still = True
    head.run(0.5)
    head.each_cycle.append(lambda: head.bus.command({PAN: goal(head)}))
    head.run(8.0)
    assert not head.complaints
