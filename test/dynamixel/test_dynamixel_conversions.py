from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from head_tracking.dynamixel import (
    ErrorBits,
    RangeError,
    ServoCalibration,
    describe_errors,
    servo_model,
)
from head_tracking.dynamixel.control_table import (
    decode_sign_magnitude,
    encode_sign_magnitude,
)

TABLE = servo_model("AX-12").control_table


@pytest.mark.parametrize(
    ("name", "value", "data"),
    [
        ("Goal Position", 512, "00 02"),
        ("Goal Position", 1023, "FF 03"),
        ("LED", 1, "01"),
    ],
)
def test_low_byte_comes_first(name: str, value: int, data: str) -> None:
    assert TABLE.block(name).encode(value) == bytes.fromhex(data)


@pytest.mark.parametrize(("name", "value"), [("LED", -1), ("LED", 256), ("Goal Position", 65536)])
def test_value_that_does_not_fit_is_refused(name: str, value: int) -> None:
    with pytest.raises(RangeError):
        TABLE.block(name).encode(value)


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


@given(st.integers(0, 1023), st.integers(0, 1023))
def test_ticks_round_trip(tick: int, zero: int) -> None:
    for calibration in (
        ServoCalibration("joint", 1, zero, 0, 1023),
        ServoCalibration("joint", 1, zero, 1023, 0),
    ):
        assert calibration.ticks(calibration.position(tick)) == tick


def test_error_bits_in_words() -> None:
    assert describe_errors(ErrorBits(36)) == "overheating, overload"
    assert describe_errors(ErrorBits(0)) == "none"
