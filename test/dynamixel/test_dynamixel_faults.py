"""Thousands of cycles on a simulated bus that is never well; see also `scripts/benchmark bus`."""

from __future__ import annotations

import math
from contextlib import suppress
from random import Random

import pytest
from simulated_device import Bench

from head_tracking.dynamixel import (
    BusReading,
    DynamixelError,
    EventKind,
    Goal,
    GoalError,
    JointConfiguration,
    ServoBus,
    ServoModel,
    Torque,
    servo_model,
)
from head_tracking.simulation import Fault, Faults, SimulatedBus, SimulatedServo, WriteLog

PERIOD = 0.02
FASTEST = 7.0  # rad/s


class Ordeal:
    """Two servos, a bus of ours, and what goes wrong.

    Args:
        models: of the servos.
        kinds: what goes wrong.
        seed: when.
    """

    def __init__(self, models: list[str], kinds: tuple[Fault, ...], seed: int = 1) -> None:
        self.faults = Faults(Random(seed), 0.0, kinds, pause=(0.1, 0.5))
        self.servos = [
            SimulatedServo(i + 1, servo_model(name), boot_time=0.0) for i, name in enumerate(models)
        ]
        self.bench = Bench(
            SimulatedBus(self.servos, faults=self.faults, write_log=WriteLog(1_000_000))
        )
        self.joints = [_joint(servo.id, servo.model) for servo in self.servos]
        bench = self.bench
        self.bus = ServoBus(bench.port, self.joints, bench.now, monotonic=bench.now)
        self.bus.connect()
        self.readings: list[BusReading] = []
        self.events: list[EventKind] = []

    def run(self, cycles: int, rate: float) -> None:
        self.faults.rate = rate
        due = self.bench.now()
        for k in range(cycles):
            due = max(due + round(PERIOD * 1e9), self.bench.now())
            self.bench.clock.now = due
            with suppress(GoalError):
                self.bus.command(
                    {j.joint_name: Goal(0.5 * math.sin(0.03 * k + j.id), 3.0) for j in self.joints}
                )
            reading = self.bus.step()
            self.readings.append(reading)
            self.events += [event.kind for event in reading.events]
            self.check(reading)
            if k % 50 == 0:
                self.recover()

    def recover(self) -> None:
        if any(self.bus.torque(j.joint_name) is Torque.OFF_BY_FAULT for j in self.joints):
            with suppress(DynamixelError):
                self.bus.recover()

    def check(self, reading: BusReading) -> None:
        """What is told was true when it was stamped."""
        for joint in self.joints:
            state = reading.states.get(joint.joint_name)
            if state is None:
                continue
            age = (self.bench.now() - state.stamp) * 1e-9 + 0.001
            true = joint.position(self.bench.bus[joint.id].true_ticks)
            assert abs(true - state.position) <= 2 * joint.resolution + FASTEST * age

    def goals_outside(self) -> int:
        ranges = {joint.id: joint.tick_range for joint in self.joints}
        return sum(
            not ranges[taken.id][0] <= taken.goal <= ranges[taken.id][1]
            for taken in self.bench.bus.write_log.writes
            if "Goal Position" in taken.names
        )

    def full_speeds(self) -> int:
        """Goals that came with a speed of 0, which is full speed."""
        return sum(
            taken.speed == 0 and "Goal Position" in taken.names
            for taken in self.bench.bus.write_log.writes
        )


def _joint(servo_id: int, model: ServoModel) -> JointConfiguration:
    low, high = model.ticks // 4, 3 * model.ticks // 4
    return JointConfiguration(
        f"j{servo_id}", f"c{servo_id}", servo_id, model.center, low, high, model=model
    )


@pytest.mark.parametrize("kind", Fault, ids=lambda kind: kind.name.lower())
@pytest.mark.parametrize("name", ["AX-12", "MX-28", "XM430-W350", "XL-320"])
def test_each_fault_is_survived_and_passes(name: str, kind: Fault) -> None:
    ordeal = Ordeal([name, name], (kind,))
    ordeal.run(200, 0.1)
    assert ordeal.faults.counts[kind] > 3
    assert ordeal.goals_outside() == ordeal.full_speeds() == 0
    ordeal.run(80, 0.0)
    assert all(len(reading.states) == 2 for reading in ordeal.readings[-20:])
    for joint in ordeal.joints:
        assert ordeal.bus.torque(joint.joint_name) is Torque.ON


@pytest.mark.parametrize(
    "names", [["AX-12", "XM430-W350"], ["MX-28", "MX-28"], ["XL430-W250", "XL430-W250", "XL-320"]]
)
def test_all_faults_at_once_on_mixed_models(names: list[str]) -> None:
    ordeal = Ordeal(names, tuple(Fault), seed=7)
    ordeal.run(800, 0.05)
    assert ordeal.goals_outside() == ordeal.full_speeds() == 0
    ordeal.run(100, 0.0)
    assert all(len(reading.states) == len(names) for reading in ordeal.readings[-20:])


def test_adapter_that_echoes_everything_is_tolerated() -> None:
    servos = [SimulatedServo(1), SimulatedServo(2, servo_model("XM430-W350"))]
    bench = Bench(SimulatedBus(servos, echo=True))
    joints = [_joint(servo.id, servo.model) for servo in servos]
    bus = ServoBus(bench.port, joints, bench.now, monotonic=bench.now)
    bus.connect()
    for _ in range(100):
        bus.command({"j1": Goal(0.3), "j2": Goal(-0.3)})
        bench.pass_time(PERIOD)
        reading = bus.step()
    assert reading.states["j1"].position == pytest.approx(0.3, abs=0.02)
    assert reading.states["j2"].position == pytest.approx(-0.3, abs=0.02)
    assert sum(servo.timeouts + servo.corrupt for servo in bus.statistics().servos) == 0


def test_adapter_with_a_latency_of_16_ms_is_waited_for() -> None:
    bench = Bench([SimulatedServo(1), SimulatedServo(2)])
    bench.line = type(bench.line)(bench.bus, bench.clock, latency=0.016)
    joints = [_joint(i, servo_model("AX-12")) for i in (1, 2)]
    bus = ServoBus(bench.port, joints, bench.now, monotonic=bench.now)
    bus.connect()
    for _ in range(100):
        bench.pass_time(PERIOD)
        assert len(bus.step().states) == 2
    assert sum(servo.timeouts for servo in bus.statistics().servos) == 0


def test_adapter_pulled_out_and_plugged_in_in_the_middle_of_everything() -> None:
    ordeal = Ordeal(["AX-12", "XM430-W350"], ())
    for _ in range(20):
        ordeal.run(30, 0.0)
        ordeal.bench.line.plugged = False
        ordeal.run(5, 0.0)
        assert not ordeal.readings[-1].states
        ordeal.bench.line.plugged = True
        ordeal.run(25, 0.0)
        assert len(ordeal.readings[-1].states) == 2
    assert ordeal.events.count(EventKind.PORT_RETURNED) == 20
    assert ordeal.goals_outside() == 0
