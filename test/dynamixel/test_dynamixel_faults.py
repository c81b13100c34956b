"""Thousands of cycles on a simulated bus that is never well; see also the benchmark `bus`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import pytest
from answer_hook import OnAnswers
from ordeal import PERIOD, Ordeal, ordeal_joint
from simulated_device import Bench, SimulatedDevice

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
    ordeal.run(200, 0.1)
    assert ordeal.faults.counts[kind] > 3
    assert ordeal.goals_outside() == ordeal.full_speeds() == 0
    ordeal.run(80, 0.0)
    assert all(len(reading.states) == 2 for reading in ordeal.readings[-20:])
    for joint in ordeal.joints:
        assert ordeal.bus.joint(joint.joint_name).torque is Torque.ON


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


def stalled_once(stall: int) -> OnAnswers:
    """A servo that answers its first write late, while others may talk."""
    left = [stall]

    def line(answer: Answer) -> Iterator[Answer]:
        yield replace(answer, stalled=left.pop()) if left else answer

    return OnAnswers(line)


@pytest.mark.parametrize("name", ["AX-12", "XM430-W350", "STS3215"])
def test_late_answer_to_a_write_is_not_taken_for_the_next_one(name: str) -> None:
    model = servo_model(name)
    torque = model.control_table["Torque Enable"].address
    for stall in range(0, 6_000_000, 29_000):
        bench = Bench(SimulatedBus([SimulatedServo(1, name)], faults=stalled_once(stall)))
        bench.port = DynamixelPort(
            "simulated", reply_timeout=0.002, clock=bench.clock,
            open_device=lambda *_, line=bench.line: SimulatedDevice(line),
        )  # fmt: skip
        bench.port.open()
        for _ in range(3):
            with suppress(CommunicationError):
                bench.port.write(1, torque, b"\0", protocol=model.protocol)
            with suppress(CommunicationError):
                bench.port.read(1, torque, 1, model.protocol)
        overlaps = bench.line.overlaps
        assert overlaps[Overlap.REQUEST] == overlaps[Overlap.STATUS] == 0, stall
