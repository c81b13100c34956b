"""What the counts of Dynamixel registers stand for.

Sources: the ROBOTIS e-manual page of each model.
"""

from __future__ import annotations

import math
from typing import Final

from head_tracking.dynamixel.control_table import Unit

RPM: Final = 2.0 * math.pi / 60.0
"""One revolution per minute, in rad/s."""

AX_SPEED: Final = 0.111 * RPM
MX_SPEED: Final = 0.114 * RPM
X_SPEED: Final = 0.229 * RPM
MX_ACCELERATION: Final = math.radians(8.583)
X_ACCELERATION: Final = 214.577 * RPM / 60.0

AX_TICKS: Final = 1024
"""Positions of AX and XL-320 over 300 degrees; one is 300/1024 degrees, as in dynamixel_motor."""

MX_TICKS: Final = 4096
"""Positions of MX and X over a whole turn."""

AX_ANGLE: Final = math.radians(300.0)
MX_ANGLE: Final = 2.0 * math.pi

VOLT: Final = Unit("V", 0.1)
CELSIUS: Final = Unit("°C")
DELAY: Final = Unit("µs", 2.0)
MILLISECOND: Final = Unit("ms")
PER_MILLE: Final = Unit("%", 0.1)
PWM: Final = Unit("%", 0.113)
WATCHDOG: Final = Unit("ms", 20.0)
AX_POSITION: Final = Unit("rad", AX_ANGLE / AX_TICKS, 512.0)
MX_POSITION: Final = Unit("rad", MX_ANGLE / MX_TICKS, 2048.0)
AX_OFFSET: Final = Unit("rad", AX_ANGLE / AX_TICKS)
MX_OFFSET: Final = Unit("rad", MX_ANGLE / MX_TICKS)
AX_VELOCITY: Final = Unit("rad/s", AX_SPEED)
MX_VELOCITY: Final = Unit("rad/s", MX_SPEED)
X_VELOCITY: Final = Unit("rad/s", X_SPEED)
MX_RAMP: Final = Unit("rad/s²", MX_ACCELERATION)
X_RAMP: Final = Unit("rad/s²", X_ACCELERATION)


def milliampere(scale: float, zero: float = 0.0) -> Unit:
    """Return the unit of a current register: mA for one count, and the count that stands for 0."""
    return Unit("mA", scale, zero)
