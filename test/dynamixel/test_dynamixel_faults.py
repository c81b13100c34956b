"""Hundreds of cycles on a simulated bus that is never well; see also the benchmark `bus`."""

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from random import Random

import pytest
from dynamixel_fakes import submit
from simulated_device import Bench, OnAnswers, Rig

from head_tracking.dynamixel import (
    BusReading,
    CommunicationError,
    Goal,
    GoalError,
    Torque,
    servo_model,
)
from head_tracking.simulation import (
    Answer,
    Fault,
    Faults,
    Overlap,
    SimulatedBus,
    SimulatedServo,
)

FASTEST = 7.0  # rad/s


class Ordeal(Rig):
    """Servos of which something goes wrong with each packet, at a rate."""

    def __init__(self, models: list[str], kinds: tuple[Fault, ...], seed: int = 1) -> None:
        self.faults = Faults(Random(seed), 0.0, kinds, pause=(0.1, 0.5))
        servos = [SimulatedServo(i, name, boot_time=0.0) for i, name in enumerate(models, 1)]
        super().__init__(SimulatedBus(servos, faults=self.faults, kept_writes=1_000_000))

    def run(self, cycles: int, rate: float) -> list[BusReading]:
        self.faults.rate = rate
        readings = []
        for k in range(cycles):
            with suppress(GoalError):
                self.bus.command(
                    {j.joint_name: Goal(0.5 * math.sin(0.03 * k + j.id), 3.0) for j in self.joints}
                )
            readings.append(self.step())
            self.check()
            if k % 50 == 0 and Torque.OFF_BY_FAULT in self.states:
                submit(self.bus, self.bus.recovering())  # others may be taking steps for the joint
        return readings

    @property
    def states(self) -> set[Torque]:
        return {self.bus.joint(joint.joint_name).torque for joint in self.joints}

    def check(self) -> None:
        """What is told was true when it was stamped, and nothing that is written is wrong."""
        for joint in self.joints:
            state = self.reading.states.get(joint.joint_name)
            if state is None:
                continue
            age = (self.bench.now() - state.stamp) * 1e-9 + 0.001
            true = joint.position(self.bench.bus[joint.id].true_ticks)
            assert abs(true - state.position) <= 2 * joint.resolution + FASTEST * age
        ranges = {joint.id: joint.tick_range for joint in self.joints}
        log = self.bench.bus.writes
        for write in log:
            if "Goal Position" in write.names:
                assert ranges[write.id][0] <= write.goal <= ranges[write.id][1]
                assert write.speed != 0  # full speed
        log.clear()


@pytest.mark.parametrize("kind", Fault, ids=lambda kind: kind.name.lower())
@pytest.mark.parametrize("names", [["AX-12", "XM430-W350"], ["STS3215", "STS3215"]], ids="+".join)
def test_each_fault_is_survived_and_passes(names, kind):
    ordeal = Ordeal(names, (kind,))
    ordeal.run(60, 0.15)
    assert ordeal.faults.counts[kind] > 3
    for _ in range(8):
        readings = ordeal.run(20, 0.0)
        if ordeal.states == {Torque.ON} and all(len(each.states) == 2 for each in readings):
            return
    raise AssertionError((ordeal.states, ordeal.reading))


@pytest.mark.parametrize(
    "names", [["AX-12", "XM430-W350"], ["MX-28", "MX-28"], ["XL430-W250", "XL430-W250", "XL-320"]]
)
def test_all_faults_at_once_on_mixed_models(names):
    ordeal = Ordeal(names, tuple(Fault), seed=7)
    ordeal.run(300, 0.05)
    readings = ordeal.run(100, 0.0)
    assert all(len(reading.states) == len(names) for reading in readings[-20:])
    overlaps = ordeal.bench.line.overlaps
    assert overlaps[Overlap.REQUEST] == overlaps[Overlap.STATUS] == 0, overlaps


OWN = tuple(kind for kind in Fault if kind not in (Fault.STALL, Fault.DELAY, Fault.ECHO))
"""Without those in which a servo is late of itself."""
HALF = (Fault.MISHEARING, Fault.CORRUPT, Fault.TRUNCATE)
"""The first one's reply is damaged, and the second one's is still to come."""


@pytest.mark.parametrize(
    ("names", "kinds", "seed", "rate"),
    [
        (["AX-12", "XL-320", "MX-28"], OWN, 3, 0.1),
        (["MX-28"] * 2, HALF, 5, 0.3),
        (["AX-12"] * 2, HALF, 3, 0.3),
        (["XM430-W350"] * 3, HALF, 5, 0.3),
    ],
)
def test_the_driver_never_speaks_while_a_servo_does(names, kinds, seed, rate):
    ordeal = Ordeal(names, kinds, seed)
    ordeal.run(200, rate)
    overlaps = ordeal.bench.line.overlaps
    assert overlaps[Overlap.REQUEST] == overlaps[Overlap.STATUS] == 0, overlaps


class Misheard(OnAnswers):
    """An AX hears a packet of 239 bytes more instead of its next one."""

    now = False

    def request(self, bus: SimulatedBus, data: bytes, now: int) -> tuple[bytes, list[Answer]]:
        if self.now and data.startswith(b"\xff\xff\x01"):
            self.now = False
            return data[:3] + b"\xef" + data[4:], []
        return data, []


def test_a_servo_that_has_misheard_the_length_of_a_packet_is_read_again_within_100_ms():
    misheard = Misheard(lambda answer: (answer,))
    servos = [SimulatedServo(1), SimulatedServo(2, "XM430-W350")]
    rig = Rig(SimulatedBus(servos, faults=misheard))
    rig.step(20)
    misheard.now = True
    rig.step(4)
    assert not misheard.now
    assert set(rig.reading.states) == {"j1", "j2"}
    assert rig.kinds == []


def stalled(*stalls: int) -> OnAnswers:
    """A servo that gives its first answers late, while others may talk."""
    left = list(stalls)

    def line(answer: Answer) -> Iterator[Answer]:
        yield replace(answer, stalled=left.pop(0)) if left else answer

    return OnAnswers(line)


@pytest.mark.parametrize("first", [(), (3_900_000,), (6_300_000, 4_200_000)])
@pytest.mark.parametrize("name", ["AX-12", "XM430-W350", "STS3215"])
def test_late_answers_to_writes_are_not_taken_for_the_next_ones(name, first):
    model = servo_model(name)
    torque = model.control_table["Torque Enable"].address
    for stall in range(0, 5_000_000, 145_000):
        servos = SimulatedBus([SimulatedServo(1, name)], faults=stalled(*first, stall))
        bench = Bench(servos, reply_timeout=0.002)
        bench.port.open()
        for _ in range(8):
            with suppress(CommunicationError):
                bench.port.write(1, torque, b"\0", protocol=model.protocol)
        with suppress(CommunicationError):
            bench.port.read(1, torque, 1, model.protocol)
        overlaps = bench.line.overlaps
        assert overlaps[Overlap.REQUEST] == overlaps[Overlap.STATUS] == 0, stall


def test_a_late_answer_of_another_protocol_is_not_taken_for_a_damaged_one():
    for late in range(1_500_000, 4_000_000, 58_000):
        delays = [0, 0, late]  # of the answers to two writes and a read

        def line(answer, delays=delays):
            yield replace(answer, late=delays.pop(0)) if delays else answer

        servos = [SimulatedServo(1), SimulatedServo(2, "XM430-W350")]
        bench = Bench(SimulatedBus(servos, faults=OnAnswers(line)), reply_timeout=0.002)
        bench.port.open()
        bench.port.write(1, 5, b"\xfe")  # Return Delay Time: 508 us
        bench.port.write(2, 104, bytes.fromhex("FF FF FF FF 07 03 00 00"), protocol=2)
        with suppress(CommunicationError):
            bench.port.read(2, 104, 8, 2)  # the data look like a packet of protocol 1.0
        for _ in range(3):
            assert len(bench.port.read(1, 36, 2).data) == 2, late
        assert bench.line.overlaps[Overlap.REQUEST] == 0, late
