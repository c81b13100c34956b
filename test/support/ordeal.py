"""A bus on servos that are never well, in simulated time."""

from __future__ import annotations

import math
from contextlib import suppress
from random import Random

from dynamixel_fakes import submit
from simulated_device import Bench, joint_of

from head_tracking.dynamixel import (
    BusReading,
    EventKind,
    Goal,
    GoalError,
    JointConfiguration,
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
        self.joints = [
            ordeal_joint(servo.id, servo_model(servo.model.name)) for servo in self.servos
        ]
        bench = self.bench
        self.bus = bench.servo_bus(self.joints)
        self.bus.connect()
        self.readings: list[BusReading] = []
        self.events: list[EventKind] = []

    def run(self, cycles: int, rate: float) -> None:
        self.faults.rate = rate
        due = self.bench.now()
        for k in range(cycles):
            due = max(due + round(PERIOD * 1e9), self.bench.now())
            while self.bus.cycle.fill(due):
                pass
            self.bench.clock.now = max(due, self.bench.now())
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
        if any(self.bus.joint(j.joint_name).torque is Torque.OFF_BY_FAULT for j in self.joints):
            submit(self.bus, self.bus.recovering())  # others may be taking steps for the joint

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


def ordeal_joint(servo_id: int, model: ServoModel) -> JointConfiguration:
    return joint_of(servo_id, model, model.ticks // 4, 3 * model.ticks // 4)
