"""Another program on the line: every wait is bounded, and STOP finds a gap."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import pytest
from second_master import SecondMaster
from simulated_device import Bench, joint_of

from head_tracking.dynamixel import (
    CommunicationError,
    DynamixelPort,
    Goal,
    ServoModel,
    TorqueError,
    servo_model,
)
from head_tracking.dynamixel.exceptions import LineBusyError
from head_tracking.dynamixel.protocol import Status, sync_write_packet
from head_tracking.dynamixel.servo import run
from head_tracking.simulation import SimulatedServo

models = pytest.mark.parametrize(
    "model", [servo_model(name) for name in ("AX-12", "STS3215", "SCS0009")], ids=lambda m: m.name
)


def torque(model: ServoModel) -> int:
    return model.control_table["Torque Enable"].address


def torque_off(model: ServoModel, *ids: int) -> bytes:
    return sync_write_packet(1, torque(model), dict.fromkeys(ids, b"\0"))


def bench(gap: float, model: ServoModel) -> tuple[Bench, SecondMaster]:
    made = Bench([SimulatedServo(i, model) for i in (1, 2)])
    made.port.open()
    master = SecondMaster(made.line, made.clock, gap)
    made.port._line = master  # type: ignore[assignment]
    return made, master


def feedback(port: DynamixelPort, model: ServoModel) -> Status:
    return port.read(2, model.feedback.address, model.feedback.length)


CALLS: dict[str, Callable[[DynamixelPort, ServoModel], object]] = {
    "read": feedback,
    "ping": lambda port, model: port.ping(2),
    "write": lambda port, model: port.write(2, torque(model), b"\0"),
}


@models
@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("gap", [0.0, 0.0002, 0.0009, 0.01])
def test_no_transaction_waits_long_for_a_second_master(
    call: str, gap: float, model: ServoModel
) -> None:
    made, _ = bench(gap, model)
    for _ in range(40):
        begin = made.clock.now
        with suppress(CommunicationError):
            CALLS[call](made.port, model)
        assert made.clock.now - begin < 0.06 * 1e9
        made.pass_time(0.003)
    assert len(made.port._buffer) < 10_000


@models
def test_servos_are_read_between_the_packets_of_a_second_master(model: ServoModel) -> None:
    made, master = bench(0.002, model)
    master.speaks = False
    expected = feedback(made.port, model).data
    master.speaks = True
    replies = 0
    for _ in range(200):
        with suppress(CommunicationError):
            replies += feedback(made.port, model).data == expected
        made.pass_time(0.0031)
    assert replies > 50


@models
@pytest.mark.parametrize("gap", [0.00025, 0.0009, 0.005])
@pytest.mark.parametrize("known", [False, True], ids=["unknown", "known"])
def test_stop_is_sent_between_the_packets_of_a_second_master(
    gap: float, known: bool, model: ServoModel
) -> None:
    for offset in range(0, 500_000, 37_000):
        made, master = bench(gap, model)
        if known:
            with pytest.raises(CommunicationError):
                for _ in range(20):
                    made.port.read(1, model.feedback.address, 8)
        made.clock.now += offset
        made.pass_time(0.01)
        begin = made.clock.now
        before = master.spoken_over
        made.port.sync_write(torque(model), {1: b"\0"}, patience=0.5)
        assert made.clock.now - begin < 0.5 * 1e9
        assert master.spoken_over == before
        assert master.heard[-1] == torque_off(model, 1)


@models
def test_stop_that_finds_no_gap_is_reported(model: ServoModel) -> None:
    made, master = bench(0.0, model)
    master._period = master._spoken[0][1]  # requests without a pause
    made.pass_time(0.01)
    begin = made.clock.now
    with pytest.raises(LineBusyError):
        made.port.sync_write(torque(model), {1: b"\0"}, patience=0.1)
    assert 0.1e9 <= made.clock.now - begin < 0.11e9
    assert not master.heard and not master.spoken_over


def test_a_quiet_line_is_used_at_once() -> None:
    model = servo_model("AX-12")
    made, master = bench(0.0, model)
    master.speaks = False
    begin = made.clock.now
    made.port.sync_write(torque(model), {1: b"\0"}, patience=0.5)
    assert made.clock.now == begin
    assert master.heard == [torque_off(model, 1)]


@models
@pytest.mark.parametrize("gap", [0.00025, 0.0009, 0.005])
def test_stop_relaxes_servos_or_reports_that_it_could_not(gap: float, model: ServoModel) -> None:
    servos = [SimulatedServo(i, model) for i in (1, 2)]
    made = Bench(servos)
    first, last = model.goal_range
    bus = made.servo_bus([joint_of(i, model, first, last) for i in (1, 2)])
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
    assert torque_off(model, 1, 2) in master.heard
