"""Instructions and registers of the simulated servo, without motion."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from simulated_packets import InstructionPacket, InstructionPacket2, StatusPacket, write

from head_tracking.dynamixel import servo_model
from head_tracking.dynamixel.protocol import ErrorBits
from head_tracking.simulation import SimulatedServo, WriteLog

Packet = InstructionPacket
MS = 1_000_000
SECOND = 1000 * MS
TABLE = servo_model("AX-12").control_table
RANGE = StatusPacket(1, ErrorBits.RANGE)


def read(servo: SimulatedServo, name: str) -> int:
    register = TABLE[name]
    status = servo.execute(Packet.read(servo.id, register.address, register.size), 0)
    assert status is not None and not status.error
    return int.from_bytes(status.data, "little")


@pytest.mark.parametrize(("address", "length"), [(49, 2), (50, 1), (0, 51), (255, 1), (0, 0)])
def test_read_behind_the_table_is_a_range_error(address: int, length: int) -> None:
    assert SimulatedServo(1).execute(Packet.read(1, address, length), 0) == RANGE


def test_write_with_one_bad_value_changes_nothing() -> None:
    servo = SimulatedServo(1)
    assert servo.execute(Packet.write(1, 30, b"\xf4\x01\xff\xff"), 0) == RANGE
    assert (read(servo, "Goal Position"), read(servo, "Moving Speed")) == (512, 0)


def test_goal_outside_the_angle_limits_is_refused() -> None:
    servo = SimulatedServo(1)
    write(servo, "CW Angle Limit", 300)
    write(servo, "CCW Angle Limit", 800)
    for goal in (299, 801):
        assert write(servo, "Goal Position", goal) == ErrorBits.ANGLE_LIMIT
    assert read(servo, "Goal Position") == 512
    assert read(servo, "Torque Enable") == 0
    for goal in (300, 800):
        assert write(servo, "Goal Position", goal) == 0


@given(
    st.sampled_from(["AX-12", "XM430-W350", "XL-320", "XC330-T288", "STS3215", "SCS0009"]),
    st.integers(0, 255),
    st.binary(max_size=60),
)
def test_no_instruction_makes_a_servo_raise(model: str, code: int, parameters: bytes) -> None:
    servo = SimulatedServo(1, model)
    packet = Packet if servo.model.protocol == 1 else InstructionPacket2
    for servo_id in (1, 254):
        servo.execute(packet(servo_id, code, parameters), 0)
    servo.advance(5_000_000)
    servo.register("Present Position")


# errors


@pytest.mark.parametrize("model", ["AX-12", "MX-64"])
def test_blocked_servo_shuts_down_and_comes_back_by_its_torque_limit(model: str) -> None:
    servo = SimulatedServo(1, servo_model(model))
    servo.advance(0)
    goal = servo.model.center + 200
    write(servo, "Goal Position", goal)
    servo.drive.impede(1.0)
    servo.advance(3 * SECOND)
    assert servo.register("Torque Limit") == 0
    assert servo.register("Torque Enable") == 1
    servo.drive.impede(0.0)
    servo.advance(60 * SECOND)
    now = 60 * SECOND
    status = servo.execute(Packet.read(1, 36, 2), now)
    assert status is not None and status.error == ErrorBits.OVERLOAD and len(status.data) == 2
    blocked = servo.true_ticks
    assert write(servo, "Goal Position", goal, now) == ErrorBits.OVERLOAD
    servo.advance(now + SECOND)
    assert servo.true_ticks == blocked
    assert write(servo, "Torque Limit", 1023, now + SECOND) == 0
    servo.advance(now + 3 * SECOND)
    assert servo.true_ticks == pytest.approx(goal, abs=6)


def test_write_log_contains_accepted_writes_only() -> None:
    servo = SimulatedServo(3)
    servo.write_log = WriteLog()
    servo.execute(Packet.write(3, 30, bytes.fromhex("F4 01 64 00")), 5)
    write(servo, "LED", 1)
    write(servo, "CW Angle Limit", 400)
    servo.execute(Packet.write(3, 30, bytes.fromhex("2C 01")), 6)  # below the limit
    write(servo, "Torque Enable", 0, 7)
    assert servo.write_log.goals(3) == [500]
    taken = servo.write_log.writes
    assert [(t.time, t.goal, t.speed, t.torque) for t in taken] == [
        (5, 500, 100, True),
        (7, 500, 100, False),
    ]


# MX


def test_mx_goal_acceleration_ramps_the_speed() -> None:
    servo = SimulatedServo(1, servo_model("MX-28"))
    servo.advance(0)
    write(servo, "Goal Acceleration", 10)  # 1.5 rad/s2
    servo.execute(Packet.write(1, 30, bytes.fromhex("A0 0F 00 02")), 0)
    servo.advance(500 * MS)
    assert servo.drive.speed == pytest.approx(0.75, rel=0.15)
