"""Pure conversions between register values and SI units.

Sources: ROBOTIS e-manual pages AX-12A (units, sign bits) and protocol 1.0 (byte order).
"""

from __future__ import annotations

import math

from head_tracking.dynamixel.exceptions import RangeError

SIGN_BIT = 10
"""AX, MX (protocol 1.0) and XL-320 mark clockwise speed and load by this bit."""


def encode_unsigned(value: int, size: int) -> bytes:
    """Return `value` as `size` bytes, low byte first.

    Raises:
        RangeError: The value is negative or needs more bytes.
    """
    try:
        return value.to_bytes(size, "little")
    except OverflowError:
        raise RangeError(
            f"{value} does not fit into {size} byte(s); allowed are 0 to {256**size - 1}"
        ) from None


def encode_sign_magnitude(value: int, sign_bit: int = SIGN_BIT) -> int:
    """Return a register value: magnitude in the low bits, `sign_bit` set when negative (clockwise).

    Raises:
        RangeError: The magnitude needs more than `sign_bit` bits.
    """
    magnitude = abs(value)
    if magnitude >= 1 << sign_bit:
        limit = (1 << sign_bit) - 1
        raise RangeError(f"{value} does not fit; allowed are {-limit} to {limit}")
    return magnitude | (1 << sign_bit) if value < 0 else magnitude


def decode_sign_magnitude(raw: int, sign_bit: int = SIGN_BIT) -> int:
    """Return the signed number in a sign-magnitude register; inverse of the encoder.

    Raises:
        RangeError: A bit above the sign bit is set, or the value is negative.
    """
    if not 0 <= raw < 2 << sign_bit:
        raise RangeError(
            f"register value {raw} is no {sign_bit} bit sign-magnitude number; "
            f"allowed are 0 to {(2 << sign_bit) - 1}"
        )
    magnitude = raw & ((1 << sign_bit) - 1)
    return -magnitude if raw >> sign_bit else magnitude


def ticks_to_radians(ticks: float, zero: float, radians_per_tick: float) -> float:
    """Return the angle of a tick, in rad, counter-clockwise from the tick `zero`."""
    return (ticks - zero) * radians_per_tick


def radians_to_ticks(angle: float, zero: float, radians_per_tick: float) -> float:
    """Return the (unrounded) tick of an angle in rad; inverse of `ticks_to_radians`.

    Raises:
        RangeError: The angle is not a finite number.
    """
    if not math.isfinite(angle):
        raise RangeError(f"an angle of {angle} has no tick; it must be a finite number of radians")
    return zero + angle / radians_per_tick


def speed_to_register(speed: float, unit: float, maximum: int) -> int:
    """Return the Moving Speed value next to `speed` (rad/s), from 1 to `maximum`.

    Never 0: in joint mode 0 stands for full speed.

    Args:
        speed: Wanted speed, rad/s, above 0.
        unit: Speed of one count, rad/s.
        maximum: Highest value of the register.

    Raises:
        RangeError: The speed is not a finite number above 0.
    """
    if not (math.isfinite(speed) and speed > 0.0):
        raise RangeError(f"a speed of {speed} rad/s is not possible; it must be finite and above 0")
    return max(1, min(maximum, round(speed / unit)))
