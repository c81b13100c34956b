from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from head_tracking.dynamixel import (
    ConfigurationError,
    ErrorBits,
    RangeError,
    Register,
    describe_errors,
    servo_model,
    servo_model_by_number,
)
from head_tracking.dynamixel.control_table import (
    ControlTable,
    decode_sign_magnitude,
    encode_sign_magnitude,
)
from head_tracking.dynamixel.exceptions import UnknownRegisterError

AX_12 = servo_model("AX-12")
TABLE = AX_12.control_table
BYTE = Register("Byte", 0, 1, True, False, 0, 0, 255)


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


def test_unknown_register_lists_what_there_is() -> None:
    with pytest.raises(UnknownRegisterError, match=r"'Goal Torque'.*Goal Position"):
        TABLE["Goal Torque"]
    assert "Goal Torque" not in TABLE


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


@pytest.mark.parametrize(
    ("raw", "value"), [(0, 0), (100, 100), (1023, 1023), (1024, 0), (1124, -100), (2047, -1023)]
)
def test_bit_10_is_the_sign(raw: int, value: int) -> None:
    assert decode_sign_magnitude(raw) == value


@given(st.integers(-1023, 1023))
def test_sign_and_magnitude_round_trip(value: int) -> None:
    assert decode_sign_magnitude(encode_sign_magnitude(value)) == value


@pytest.mark.parametrize("raw", [-1, 2048, 65535])
def test_bits_above_the_sign_are_refused(raw: int) -> None:
    with pytest.raises(RangeError, match="0 to 2047"):
        decode_sign_magnitude(raw)


@pytest.mark.parametrize("value", [1024, -1024])
def test_magnitude_that_does_not_fit_is_refused(value: int) -> None:
    with pytest.raises(RangeError, match="-1023 to 1023"):
        encode_sign_magnitude(value)


def test_error_bits_in_words() -> None:
    assert describe_errors(ErrorBits(36)) == "overheating, overload"
    assert describe_errors(ErrorBits(0)) == "none"
