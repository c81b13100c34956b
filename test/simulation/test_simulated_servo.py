"""Instructions and registers of the simulated servo, without motion."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulated_packets import InstructionPacket, StatusPacket

from head_tracking.dynamixel import (
    ErrorBits,
    servo_model,
)
from head_tracking.simulation import SimulatedServo, SimulationError

Packet = InstructionPacket
TABLE = servo_model("AX-12").control_table
RANGE = StatusPacket(1, ErrorBits.RANGE)
OK = StatusPacket(1)


def write(servo: SimulatedServo, name: str, value: int) -> StatusPacket | None:
    register = TABLE[name]
    data = value.to_bytes(register.size, "little")
    return servo.execute(Packet.write(servo.id, register.address, data), 0)


def read(servo: SimulatedServo, name: str) -> int:
    register = TABLE[name]
    status = servo.execute(Packet.read(servo.id, register.address, register.size), 0)
    assert status is not None and not status.error
    return int.from_bytes(status.data, "little")


def test_ping_is_answered() -> None:
    assert SimulatedServo(1).execute(Packet.ping(1), 0) == OK


def test_packets_for_others_are_ignored() -> None:
    assert SimulatedServo(1).execute(Packet.ping(2), 0) is None


@pytest.mark.parametrize(
    "packet",
    [
        Packet.ping(254),
        Packet.read(254, 36, 2),
        Packet.write(254, 24, b"\x00"),
        Packet.reg_write(254, 30, b"\x00\x02"),
        Packet.action(),
        Packet.sync_write(30, {1: b"\x00\x02"}),
        Packet(254, 0x92, bytes.fromhex("00 02 01 1E 02 02 24")),
        Packet(254, 0x55),
    ],
    ids=lambda packet: f"0x{packet.code:02X}",
)
def test_broadcasts_are_not_answered(packet: InstructionPacket) -> None:
    assert SimulatedServo(1).execute(packet, 0) is None


def test_broadcast_write_takes_effect() -> None:
    servo = SimulatedServo(1)
    servo.execute(Packet.write(254, 25, b"\x01"), 0)
    assert read(servo, "LED") == 1


def test_read_across_registers_returns_them_all() -> None:
    status = SimulatedServo(1).execute(Packet.read(1, 36, 8), 0)
    assert status == StatusPacket(1, data=bytes.fromhex("00 02 00 00 00 00 78 1E"))


@pytest.mark.parametrize(("address", "length"), [(49, 2), (50, 1), (0, 51), (255, 1), (0, 0)])
def test_read_behind_the_table_is_a_range_error(address: int, length: int) -> None:
    assert SimulatedServo(1).execute(Packet.read(1, address, length), 0) == RANGE


def test_whole_table_can_be_read_at_once() -> None:
    status = SimulatedServo(1).execute(Packet.read(1, 0, 50), 0)
    assert status is not None and len(status.data) == 50


def test_write_across_registers_sets_them_all() -> None:
    servo = SimulatedServo(1)
    assert servo.execute(Packet.write(1, 30, b"\xf4\x01\x64\x00"), 0) == OK
    assert (read(servo, "Goal Position"), read(servo, "Moving Speed")) == (500, 100)


def test_write_with_one_bad_value_changes_nothing() -> None:
    servo = SimulatedServo(1)
    assert servo.execute(Packet.write(1, 30, b"\xf4\x01\xff\xff"), 0) == RANGE
    assert (read(servo, "Goal Position"), read(servo, "Moving Speed")) == (512, 0)


def test_half_a_register_can_be_written() -> None:
    servo = SimulatedServo(1)
    assert servo.execute(Packet.write(1, 30, b"\x05"), 0) == OK
    assert read(servo, "Goal Position") == 512 + 5


def test_half_a_register_is_checked_as_a_whole() -> None:
    servo = SimulatedServo(1)
    assert servo.execute(Packet.write(1, 31, b"\x04"), 0) == RANGE  # would be 1024
    assert read(servo, "Goal Position") == 512


@pytest.mark.parametrize("address", [10, 19, 45, 50, 200])
def test_write_to_reserved_addresses_is_refused(address: int) -> None:
    assert SimulatedServo(1).execute(Packet.write(1, address, b"\x00"), 0) == RANGE


def test_write_without_data_is_refused() -> None:
    assert SimulatedServo(1).execute(Packet.write(1, 24, b""), 0) == RANGE


@pytest.mark.parametrize("instruction", [0x00, 0x07, 0x55, 0x84, 0x92])
def test_unknown_instruction_is_an_instruction_error(instruction: int) -> None:
    status = SimulatedServo(1).execute(Packet(1, instruction), 0)
    assert status == StatusPacket(1, ErrorBits.INSTRUCTION)


def test_goal_outside_the_angle_limits_is_refused() -> None:
    servo = SimulatedServo(1)
    write(servo, "CW Angle Limit", 300)
    write(servo, "CCW Angle Limit", 800)
    for goal in (299, 801):
        assert write(servo, "Goal Position", goal) == StatusPacket(1, ErrorBits.ANGLE_LIMIT)
    assert read(servo, "Goal Position") == 512
    assert read(servo, "Torque Enable") == 0
    for goal in (300, 800):
        assert write(servo, "Goal Position", goal) == OK


def test_wheel_mode_takes_speeds_with_a_sign() -> None:
    servo = SimulatedServo(1)
    assert write(servo, "Moving Speed", 1024) == RANGE
    write(servo, "CCW Angle Limit", 0)
    assert write(servo, "Moving Speed", 2047) == OK


def test_new_id_holds_from_the_next_packet_on() -> None:
    servo = SimulatedServo(1)
    assert servo.execute(Packet.write(1, 3, b"\x05"), 0) == OK
    assert servo.execute(Packet.ping(1), 0) is None
    assert servo.execute(Packet.ping(5), 0) == StatusPacket(5)


@pytest.mark.parametrize(
    ("level", "ping", "reading", "writing"),
    [(0, True, False, False), (1, True, True, False), (2, True, True, True)],
)
def test_status_return_level(level: int, ping: bool, reading: bool, writing: bool) -> None:
    servo = SimulatedServo(1)
    servo.set_register("Status Return Level", level)
    assert (servo.execute(Packet.ping(1), 0) is not None) == ping
    assert (servo.execute(Packet.read(1, 0, 2), 0) is not None) == reading
    assert (servo.execute(Packet.write(1, 25, b"\x01"), 0) is not None) == writing
    assert servo.register("LED") == 1


def test_lock_protects_the_eeprom_and_cannot_be_undone() -> None:
    servo = SimulatedServo(1)
    assert write(servo, "Lock", 1) == OK
    assert write(servo, "CW Angle Limit", 300) == RANGE
    assert write(servo, "Lock", 0) == RANGE
    assert write(servo, "LED", 1) == OK


@pytest.mark.parametrize("name", ["Goal Position", "Moving Speed"])
def test_goal_or_speed_switches_torque_on(name: str) -> None:
    servo = SimulatedServo(1)
    write(servo, name, 100)
    assert read(servo, "Torque Enable") == 1


def test_sync_write_outside_the_limits_changes_nothing() -> None:
    servo = SimulatedServo(1)
    servo.execute(Packet.sync_write(30, {1: b"\x00\x04"}), 0)
    assert read(servo, "Goal Position") == 512


@pytest.mark.parametrize("volts", [5.9, 14.1])
def test_wrong_supply_shows_in_every_answer_and_data_stay_valid(volts: float) -> None:
    servo = SimulatedServo(1, supply_voltage=volts)
    status = servo.execute(Packet.read(1, 42, 1), 0)
    assert status == StatusPacket(1, ErrorBits.INPUT_VOLTAGE, bytes((round(volts * 10),)))


def test_overheating_shuts_down_as_the_shutdown_register_says() -> None:
    servo = SimulatedServo(1)
    servo.temperature = 75.0
    status = servo.execute(Packet.ping(1), 0)
    assert status == StatusPacket(1, ErrorBits.OVERHEATING)
    assert servo.register("Torque Limit") == 0


def test_overheating_without_its_shutdown_bit_only_warns() -> None:
    servo = SimulatedServo(1)
    servo.temperature = 75.0
    servo.set_register("Shutdown", int(ErrorBits.OVERLOAD))
    assert servo.execute(Packet.ping(1), 0) == StatusPacket(1, ErrorBits.OVERHEATING)
    assert servo.register("Torque Limit") == 1023


def test_torque_limit_comes_from_max_torque_at_power_on() -> None:
    assert SimulatedServo(1).register("Torque Limit") == 1023


def test_registers_are_set_from_outside_with_care() -> None:
    servo = SimulatedServo(1)
    servo.set_register("Model Number", 29)
    assert read(servo, "Model Number") == 29
    with pytest.raises(SimulationError, match="256"):
        servo.set_register("LED", 256)
    with pytest.raises(SimulationError, match="'Colour'"):
        servo.set_register("Colour", 1)
    with pytest.raises(SimulationError, match="'Colour'"):
        servo.register("Colour")


def test_impossible_start_is_refused() -> None:
    with pytest.raises(SimulationError, match="0 to 1023"):
        SimulatedServo(1, position=1024)


@settings(deadline=None)
@given(st.integers(0, 255), st.binary(max_size=60))
def test_no_instruction_makes_a_servo_raise(instruction: int, parameters: bytes) -> None:
    servo = SimulatedServo(1)
    for servo_id in (1, 254):
        servo.execute(Packet(servo_id, instruction, parameters), 0)
    servo.advance(5_000_000)
    assert 0 <= servo.register("Present Position") <= 1023
