"""Thousands of cycles on a simulated bus that is never well; see also the benchmark `bus`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import pytest
from answer_hook import OnAnswers
from ordeal import PERIOD, Ordeal, ordeal_joint
from simulated_device import Bench, as_device

from head_tracking.dynamixel import (
    CommunicationError,
    DynamixelPort,
    EventKind,
    Goal,
    Torque,
    servo_model,
)
from head_tracking.simulation import Answer, Fault, Overlap, SimulatedBus, SimulatedServo


@pytest.mark.parametrize("kind", Fault, ids=lambda kind: kind.name.lower())
@pytest.mark.parametrize("name", ["AX-12", "MX-28", "XM430-W350", "XL-320", "STS3215", "SCS0009"])
def test_each_fault_is_survived_and_passes(name: str, kind: Fault) -> None:
    ordeal = Ordeal([name, name], (kind,))
    ordeal.run(100, 0.1)
    assert ordeal.faults.counts[kind] > 3
    assert ordeal.goals_outside() == ordeal.full_speeds() == 0
    for _ in range(8):
        ordeal.run(20, 0.0)
        torque = {ordeal.bus.joint(joint.joint_name).torque for joint in ordeal.joints}
        if torque == {Torque.ON} and all(len(each.states) == 2 for each in ordeal.readings[-20:]):
            return
    raise AssertionError((torque, ordeal.readings[-1]))


@pytest.mark.parametrize(
    "names", [["AX-12", "XM430-W350"], ["MX-28", "MX-28"], ["XL430-W250", "XL430-W250", "XL-320"]]
)
def test_all_faults_at_once_on_mixed_models(names: list[str]) -> None:
    ordeal = Ordeal(names, tuple(Fault), seed=7)
    ordeal.run(400, 0.05)
    assert ordeal.goals_outside() == ordeal.full_speeds() == 0
    ordeal.run(100, 0.0)
    assert all(len(reading.states) == len(names) for reading in ordeal.readings[-20:])


def test_adapter_that_echoes_everything_is_tolerated() -> None:
    servos = [SimulatedServo(1), SimulatedServo(2, servo_model("XM430-W350"))]
    bench = Bench(SimulatedBus(servos, echo=True))
    joints = [ordeal_joint(servo.id, servo_model(servo.model.name)) for servo in servos]
    bus = bench.servo_bus(joints)
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
    joints = [ordeal_joint(i, servo_model("AX-12")) for i in (1, 2)]
    bus = bench.servo_bus(joints)
    bus.connect()
    for _ in range(100):
        bench.pass_time(PERIOD)
        assert len(bus.step().states) == 2
    assert sum(servo.timeouts for servo in bus.statistics().servos) == 0


def test_adapter_pulled_out_and_plugged_in_in_the_middle_of_everything() -> None:
    ordeal = Ordeal(["AX-12", "XM430-W350"], ())
    for _ in range(8):
        ordeal.run(30, 0.0)
        ordeal.bench.line.plugged = False
        ordeal.run(5, 0.0)
        assert not ordeal.readings[-1].states
        ordeal.bench.line.plugged = True
        ordeal.run(25, 0.0)
        assert len(ordeal.readings[-1].states) == 2
    assert ordeal.events.count(EventKind.PORT_RETURNED) == 8
    assert ordeal.goals_outside() == 0


def stalled(*stalls: int) -> OnAnswers:
    """A servo that gives its first answers late, while others may talk."""
    left = list(stalls)

    def line(answer: Answer) -> Iterator[Answer]:
        yield replace(answer, stalled=left.pop(0)) if left else answer

    return OnAnswers(line)


@pytest.mark.parametrize("first", [(), (3_900_000,), (6_300_000, 4_200_000)])
@pytest.mark.parametrize("name", ["AX-12", "XM430-W350", "STS3215"])
def test_late_answers_to_writes_are_not_taken_for_the_next_ones(
    name: str, first: tuple[int, ...]
) -> None:
    model = servo_model(name)
    torque = model.control_table["Torque Enable"].address
    for stall in range(0, 5_000_000, 58_000):
        servos = SimulatedBus([SimulatedServo(1, name)], faults=stalled(*first, stall))
        bench = Bench(servos)
        bench.port = DynamixelPort(
            "simulated", reply_timeout=0.002, clock=bench.clock,
            open_device=lambda *_, line=bench.line: as_device(line),
        )  # fmt: skip
        bench.port.open()
        for _ in range(8):
            with suppress(CommunicationError):
                bench.port.write(1, torque, b"\0", protocol=model.protocol)
        with suppress(CommunicationError):
            bench.port.read(1, torque, 1, model.protocol)
        overlaps = bench.line.overlaps
        assert overlaps[Overlap.REQUEST] == overlaps[Overlap.STATUS] == 0, stall


def test_a_late_answer_of_another_protocol_is_not_taken_for_a_damaged_one() -> None:
    for late in range(1_500_000, 4_000_000, 58_000):
        delays = [0, 0, late]  # of the answers to two writes and a read

        def line(answer: Answer, delays: list[int] = delays) -> Iterator[Answer]:
            yield replace(answer, late=delays.pop(0)) if delays else answer

        servos = [SimulatedServo(1), SimulatedServo(2, "XM430-W350")]
        bench = Bench(SimulatedBus(servos, faults=OnAnswers(line)))
        bench.port = DynamixelPort(
            "simulated", reply_timeout=0.002, clock=bench.clock,
            open_device=lambda *_, line=bench.line: as_device(line),
        )  # fmt: skip
        bench.port.open()
        bench.port.write(1, 5, b"\xfe")  # Return Delay Time: 508 us
        bench.port.write(2, 104, bytes.fromhex("FF FF FF FF 07 03 00 00"), protocol=2)
        with suppress(CommunicationError):
            bench.port.read(2, 104, 8, 2)  # the data look like a packet of protocol 1.0
        for _ in range(3):
            assert len(bench.port.read(1, 36, 2).data) == 2, late
        assert bench.line.overlaps[Overlap.REQUEST] == 0, late
