from __future__ import annotations

import math

import pytest

from head_tracking.dynamixel import (
    ConfigurationError,
    RangeError,
    Register,
    servo_model,
    servo_model_by_number,
)
from head_tracking.dynamixel.control_table import ControlTable
from head_tracking.dynamixel.exceptions import UnknownRegisterError

AX_12 = servo_model("AX-12")
TABLE = AX_12.control_table
ADDRESSES = {
    "Model Number": (0, 2), "Firmware Version": (2, 1), "ID": (3, 1), "Baud Rate": (4, 1),
    "Return Delay Time": (5, 1), "CW Angle Limit": (6, 2), "CCW Angle Limit": (8, 2),
    "Temperature Limit": (11, 1), "Min Voltage Limit": (12, 1), "Max Voltage Limit": (13, 1),
    "Max Torque": (14, 2), "Status Return Level": (16, 1), "Alarm LED": (17, 1),
    "Shutdown": (18, 1), "Torque Enable": (24, 1), "LED": (25, 1),
    "CW Compliance Margin": (26, 1), "CCW Compliance Margin": (27, 1),
    "CW Compliance Slope": (28, 1), "CCW Compliance Slope": (29, 1), "Goal Position": (30, 2),
    "Moving Speed": (32, 2), "Torque Limit": (34, 2), "Present Position": (36, 2),
    "Present Speed": (38, 2), "Present Load": (40, 2), "Present Voltage": (42, 1),
    "Present Temperature": (43, 1), "Registered": (44, 1), "Moving": (46, 1), "Lock": (47, 1),
    "Punch": (48, 2),
}  # fmt: skip
BYTE = Register("Byte", 0, 1, True, False, 0, 0, 255)


def test_table_has_the_vendors_addresses_and_sizes() -> None:
    assert {r.name: (r.address, r.size) for r in TABLE} == ADDRESSES
    assert len(TABLE) == len(ADDRESSES)
    assert TABLE.size == 50


def test_eeprom_ends_before_torque_enable() -> None:
    assert all(r.eeprom == (r.address < 24) for r in TABLE)


def test_read_only_registers() -> None:
    read_only = {r.name for r in TABLE if not r.writable}
    assert read_only == {
        "Model Number", "Firmware Version", "Present Position", "Present Speed", "Present Load",
        "Present Voltage", "Present Temperature", "Registered", "Moving",
    }  # fmt: skip


@pytest.mark.parametrize("register", [r for r in TABLE if r.writable], ids=lambda r: r.name)
def test_both_ends_of_a_range_round_trip(register: Register) -> None:
    assert register.minimum is not None and register.maximum is not None
    block = TABLE.block(register.name)
    for value in (register.minimum, register.maximum):
        assert block.decode(block.encode(value)) == (value,)
    with pytest.raises(RangeError, match=f"{register.name}.*{register.maximum}"):
        block.encode(register.maximum + 1)


def test_read_only_register_cannot_be_encoded() -> None:
    with pytest.raises(RangeError, match="read only"):
        TABLE.block("Present Position").encode(1)


def test_wrong_number_of_bytes_is_refused() -> None:
    with pytest.raises(RangeError, match="2 bytes, not 1"):
        TABLE.block("Present Position").decode(b"\x00")


def test_unknown_register_lists_what_there_is() -> None:
    with pytest.raises(UnknownRegisterError, match=r"'Goal Torque'.*Goal Position"):
        TABLE["Goal Torque"]
    assert "Goal Torque" not in TABLE


def test_feedback_is_one_read_of_eight_bytes() -> None:
    assert (AX_12.feedback.address, AX_12.feedback.length) == (36, 8)
    data = bytes.fromhex("00 02 00 00 00 00 78 1E")
    assert AX_12.feedback.decode(data) == (512, 0, 0, 120, 30)


def test_goal_and_speed_are_one_write_of_four_bytes() -> None:
    assert (AX_12.goal.address, AX_12.goal.length) == (30, 4)
    assert AX_12.goal.encode(512, 100) == bytes.fromhex("00 02 64 00")


def test_block_skips_what_lies_between() -> None:
    block = TABLE.block("CW Angle Limit", "CCW Angle Limit", "Status Return Level")
    data = bytes.fromhex("2C 01 20 03 FF FF FF FF FF FF 02")
    assert block.decode(data) == (300, 800, 2)


def test_block_with_gaps_cannot_be_written() -> None:
    with pytest.raises(RangeError, match="gaps"):
        TABLE.block("CCW Angle Limit", "Temperature Limit").encode(800, 70)


def test_block_wants_the_right_number_of_bytes_and_values() -> None:
    with pytest.raises(RangeError, match="8 bytes, not 7"):
        AX_12.feedback.decode(bytes(7))
    with pytest.raises(RangeError, match="2 values, not 1"):
        AX_12.goal.encode(512)


def test_block_must_rise() -> None:
    with pytest.raises(RangeError, match="ID"):
        TABLE.block("Baud Rate", "ID")


def test_table_refuses_overlaps_and_double_names() -> None:
    with pytest.raises(RangeError, match="overlaps"):
        ControlTable("test", (BYTE, Register("Word", 0, 2, False, False)))
    with pytest.raises(RangeError, match="twice"):
        ControlTable("test", (BYTE, Register("Byte", 1, 1, False, False)))


@pytest.mark.parametrize("name", ["AX-12", "AX-12A", "ax-12+"])
def test_model_is_found_by_any_of_its_names(name: str) -> None:
    assert servo_model(name) is AX_12


def test_model_is_found_by_number() -> None:
    assert servo_model_by_number(12) is AX_12


def test_unknown_models_list_the_known_ones() -> None:
    with pytest.raises(ConfigurationError, match=r"'AX-99'; known are .*AX-12 \(12\)"):
        servo_model("AX-99")
    with pytest.raises(ConfigurationError, match=r"4711; known are .*AX-12 \(12\)"):
        servo_model_by_number(4711)


def test_vendors_figures() -> None:
    assert AX_12.radians_per_tick == pytest.approx(0.00511327, abs=1e-8)
    assert AX_12.speed_unit == pytest.approx(0.0116239, abs=1e-7)
    assert AX_12.no_load_speed == pytest.approx(6.178, abs=1e-3)
    assert AX_12.radians_per_tick * AX_12.ticks == pytest.approx(math.radians(300))
