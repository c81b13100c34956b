"""Another program on the line: nothing waits for ever, and what must get out gets out."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import pytest
from second_master import SecondMaster
from simulated_device import Bench

from head_tracking.dynamixel import (
    CommunicationError,
    DynamixelPort,
    Goal,
    JointConfiguration,
    ServoBus,
    TorqueError,
)
from head_tracking.dynamixel.exceptions import LineBusyError
from head_tracking.dynamixel.servo import run
from head_tracking.simulation import SimulatedServo

TORQUE_OFF_BOTH = bytes.fromhex("FF FF FE 08 83 18 01 01 00 02 00 5A")
TORQUE_OFF = bytes.fromhex("FF FF FE 06 83 18 01 01 00 5E")


def bench(gap: float) -> tuple[Bench, SecondMaster]:
    made = Bench([SimulatedServo(1), SimulatedServo(2)])
    made.port.open()
    master = SecondMaster(made.line, made.clock, gap)
    made.port._line = master  # type: ignore[assignment]
    return made, master


Call = Callable[[DynamixelPort], object]
CALLS: dict[str, Call] = {
    "read": lambda port: port.read(2, 36, 8),
    "ping": lambda port: port.ping(2),
    "write": lambda port: port.write(2, 24, b"\0"),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
@pytest.mark.parametrize("gap", [0.0, 0.0002, 0.0009, 0.01])
def test_no_transaction_waits_long_for_a_second_master(call: Call, gap: float) -> None:
    made, _ = bench(gap)
    for _ in range(100):
        begin = made.clock.now
        with suppress(CommunicationError):
            call(made.port)
        assert made.clock.now - begin < 0.06 * 1e9
        made.pass_time(0.003)
    assert len(made.port._buffer) < 10_000


def test_servos_are_read_between_the_packets_of_a_second_master() -> None:
    made, _ = bench(0.002)
    replies = 0
    for _ in range(200):
        with suppress(CommunicationError):
            replies += made.port.read(2, 36, 8).data == bytes((0, 2, 0, 0, 0, 0, 120, 30))
        made.pass_time(0.0031)
    assert replies > 50


@pytest.mark.parametrize("gap", [0.00025, 0.0009, 0.005])
@pytest.mark.parametrize("known", [False, True], ids=["unknown", "known"])
def test_stop_gets_out_between_the_packets_of_a_second_master(gap: float, known: bool) -> None:
    for offset in range(0, 500_000, 37_000):
        made, master = bench(gap)
        if known:
            with pytest.raises(CommunicationError):
                for _ in range(20):
                    made.port.read(1, 36, 8)
        made.clock.now += offset
        made.pass_time(0.01)
        begin = made.clock.now
        before = master.spoken_over
        made.port.sync_write(24, {1: b"\0"}, patience=0.5)
        assert made.clock.now - begin < 0.5 * 1e9
        assert master.spoken_over == before
        assert master.heard[-1] == TORQUE_OFF


def test_stop_that_finds_no_gap_is_reported() -> None:
    made, master = bench(0.0)
    master._period = master._spoken[0][1]  # requests, one behind the other
    made.pass_time(0.01)
    begin = made.clock.now
    with pytest.raises(LineBusyError):
        made.port.sync_write(24, {1: b"\0"}, patience=0.5)
    assert 0.5e9 <= made.clock.now - begin < 0.51e9
    assert not master.heard and not master.spoken_over


def test_a_quiet_line_is_not_waited_for() -> None:
    made, master = bench(0.0)
    master.speaks = False
    begin = made.clock.now
    made.port.sync_write(24, {1: b"\0"}, patience=0.5)
    assert made.clock.now == begin
    assert master.heard == [TORQUE_OFF]


@pytest.mark.parametrize("gap", [0.00025, 0.0009, 0.005])
def test_stop_relaxes_servos_or_reports_that_it_could_not(gap: float) -> None:
    servos = [SimulatedServo(1), SimulatedServo(2)]
    made = Bench(servos)
    joints = [JointConfiguration(f"j{i}", i, controller=f"c{i}") for i in (1, 2)]
    bus = ServoBus(
        made.port, joints, made.now, monotonic=made.now, pause=lambda s: made.pass_time(float(s))
    )
    bus.connect()
    for _ in range(50):
        bus.command({"j1": Goal(0.3), "j2": Goal(-0.3)})
        made.pass_time(0.02)
        bus.step()
    assert all(servo.register("Torque Enable") for servo in servos)
    master = SecondMaster(made.line, made.clock, gap)
    made.port._line = master  # type: ignore[assignment]
    for _ in range(5):
        made.pass_time(0.02)
        bus.step()
    begin = made.clock.now
    reported: tuple[str, ...] = ()
    try:
        run(bus.stopping(None), made.pass_time)
    except TorqueError as error:
        reported = tuple(error.problems)
    assert made.clock.now - begin < 2e9
    powered = {f"j{servo.id}" for servo in servos if servo.register("Torque Enable")}
    assert powered <= set(reported)
    assert TORQUE_OFF_BOTH in master.heard
