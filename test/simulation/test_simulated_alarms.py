"""Errors of servos with protocol 1.0, and the way back from them."""

from __future__ import annotations

import pytest
from simulated_packets import InstructionPacket

from head_tracking.dynamixel import ErrorBits
from head_tracking.dynamixel.models import servo_model
from head_tracking.simulation import SimulatedServo, WriteLog

Packet = InstructionPacket
MS = 1_000_000
SECOND = 1000 * MS


def write(servo: SimulatedServo, name: str, value: int, now: int = 0) -> ErrorBits:
    register = servo_model(servo.model.name).control_table[name]
    data = value.to_bytes(register.size, "little")
    status = servo.execute(Packet.write(servo.id, register.address, data), now)
    assert status is not None
    return status.error


@pytest.mark.parametrize("model", ["AX-12", "MX-64"])
def test_blocked_servo_shuts_down_and_comes_back_by_its_torque_limit(model: str) -> None:
    servo = SimulatedServo(1, servo_model(model))
    servo.advance(0)
    goal = servo.model.center + 200
    write(servo, "Goal Position", goal)
    servo.impede(1.0)
    servo.advance(3 * SECOND)
    assert servo.register("Torque Limit") == 0
    assert servo.register("Torque Enable") == 1
    servo.impede(0.0)
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


def test_short_blockade_is_borne() -> None:
    servo = SimulatedServo(1)
    servo.advance(0)
    write(servo, "Goal Position", 700)
    servo.impede(1.0)
    servo.advance(800 * MS)
    servo.impede(0.0)
    servo.advance(3 * SECOND)
    assert servo.register("Torque Limit") == 1023
    assert servo.true_ticks == pytest.approx(700, abs=2)


def test_overload_without_its_shutdown_bit_lasts_as_long_as_its_cause() -> None:
    servo = SimulatedServo(1)
    servo.set_register("Shutdown", 0)
    servo.advance(0)
    write(servo, "Goal Position", 700)
    servo.impede(1.0)
    servo.advance(2 * SECOND)
    assert write(servo, "LED", 1, 2 * SECOND) == ErrorBits.OVERLOAD
    servo.impede(0.0)
    servo.advance(5 * SECOND)
    assert write(servo, "LED", 0, 5 * SECOND) == 0


def test_hot_servo_shuts_down_again_until_it_has_cooled() -> None:
    servo = SimulatedServo(1)
    servo.temperature = 75.0
    assert write(servo, "Torque Enable", 1) == ErrorBits.OVERHEATING
    assert servo.register("Torque Limit") == 0
    write(servo, "Torque Limit", 1023)
    servo.advance(MS)
    assert servo.register("Torque Limit") == 0
    servo.advance(1200 * SECOND)  # the 20 minutes of the manual
    assert servo.temperature < 60.0
    assert write(servo, "Torque Limit", 1023, 1200 * SECOND) == 0
    assert servo.register("Torque Limit") == 1023


def test_injected_overload_acts_like_a_real_one() -> None:
    servo = SimulatedServo(1)
    servo.overload()
    assert servo.register("Torque Limit") == 0
    assert write(servo, "LED", 1) == ErrorBits.OVERLOAD
    assert write(servo, "Torque Limit", 800) == 0


def test_power_cycle_clears_the_lock_and_the_torque() -> None:
    servo = SimulatedServo(1, boot_time=0.0)
    write(servo, "Lock", 1)
    write(servo, "Torque Enable", 1)
    write(servo, "Goal Position", 300)
    servo.power_off()
    servo.power_on()
    assert servo.register("Lock") == servo.register("Torque Enable") == 0
    assert servo.register("Goal Position") == 512
    assert servo.register("Torque Limit") == 1023


def test_write_log_keeps_what_a_servo_took_and_not_what_it_refused() -> None:
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


def test_mx_wheel_mode_keeps_a_speed() -> None:
    servo = SimulatedServo(1, servo_model("MX-28"))
    servo.advance(0)
    write(servo, "CCW Angle Limit", 0)
    write(servo, "Moving Speed", 1024 + 200)
    servo.advance(3 * SECOND)
    assert servo.register("Present Speed") == pytest.approx(1024 + 200, abs=3)


def test_mx_goal_acceleration_ramps_the_speed() -> None:
    servo = SimulatedServo(1, servo_model("MX-28"))
    servo.advance(0)
    write(servo, "Goal Acceleration", 10)  # 1.5 rad/s2
    servo.execute(Packet.write(1, 30, bytes.fromhex("A0 0F 00 02")), 0)
    servo.advance(500 * MS)
    assert servo.true_velocity == pytest.approx(0.75, rel=0.15)
