from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from head_tracking.dynamixel import servo_model
from head_tracking.dynamixel.control_table import (
    ControlTable,
    Register,
)
from head_tracking.dynamixel.exceptions import RangeError, UnknownRegisterError

AX_12 = servo_model("AX-12")
TABLE = AX_12.control_table
BYTE = Register("Byte", 0, 1, True, False, 0, 0, 255)


@pytest.mark.parametrize(
    "use",
    [
        lambda: TABLE.block("Present Position").encode(1),  # read only
        lambda: TABLE.block("CCW Angle Limit", "Temperature Limit").encode(800, 70),  # gaps
        lambda: AX_12.feedback.decode(bytes(7)),
        lambda: AX_12.goal.encode(512),
        lambda: TABLE.block("Baud Rate", "ID"),  # not in order
        lambda: TABLE["Goal Torque"],
        lambda: ControlTable("overlap", (BYTE, Register("Word", 0, 2, False, False))),
        lambda: ControlTable("twice", (BYTE, Register("Byte", 1, 1, False, False))),
    ],
)
def test_what_a_table_does_not_allow_is_refused(use: Callable[[], object]) -> None:
    with pytest.raises((RangeError, UnknownRegisterError)):
        use()


def test_vendors_figures() -> None:
    assert AX_12.radians_per_tick == pytest.approx(0.00511327, abs=1e-8)
    assert AX_12.speed_unit == pytest.approx(0.0116239, abs=1e-7)
    assert AX_12.no_load_speed == pytest.approx(6.178, abs=1e-3)
    assert AX_12.radians_per_tick * AX_12.ticks == pytest.approx(math.radians(300))


@pytest.mark.parametrize(
    ("bit", "raw", "value"),
    [
        *[(10, 0, 0), (10, 1023, 1023), (10, 1024, 0), (10, 1124, -100), (10, 2047, -1023)],
        *[(11, 2148, -100), (15, 32868, -100)],
    ],
)
def test_sign_and_magnitude(bit: int, raw: int, value: int) -> None:
    register = replace(BYTE, size=2, sign_bit=bit)
    assert register.counts(raw) == value
    assert register.from_counts(value) == (raw if value else 0)
    for wrong in (-1, 2 << bit):
        with pytest.raises(RangeError):
            register.counts(wrong)
    for wrong in (1 << bit, -1 << bit):
        with pytest.raises(RangeError):
            register.from_counts(wrong)
