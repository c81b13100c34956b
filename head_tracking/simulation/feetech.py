"""Registers and instructions of simulated Feetech servos.

Packets have the format of Dynamixel protocol 1.0 (`packets`); instructions, byte order, signs and
registers are Feetech's. Sources: ftservo-wiki 9522ce1, ft-scs.md, memory-sts.md, memory-scscl.md.
Assumptions that these sources do not confirm:

- a goal enables torque, because other programs never write Torque Enable;
- a write that a servo cannot obey is answered without an error, and changes nothing;
- an overload lasts until a restart; a servo that it does not shut down uses its Holding Torque.

In modes without goal positions the motor does not drive.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Final

from head_tracking.simulation.models import (
    Register,
    SimulatedModel,
    from_sign_magnitude,
)
from head_tracking.simulation.motion import (
    ControlLaw,
    Drive,
    DriveSettings,
    Profile,
    proportional_law,
)
from head_tracking.simulation.registers import Denial, Registers

_ZERO_IS_FASTEST = 8  # bit of Phase
_COARSE: Final = 50  # steps/s: 0.732 rpm, the precision of a speed of an STS servo
_ACCELERATION: Final = math.radians(8.7)
_GAIN_SLOPE: Final = math.radians(160.0)
"""Slope of a P gain of 1, rad: with 32, half of the stall torque is 2.5 degrees off
(TheRobotStudio/SO-ARM100 issue 134: 1.8 to 2.6)."""

_POSITION: Final = 0  # of Operating Mode


class FeetechRegisters(Registers):
    """STS and SCS servos.

    Args:
        model: The servo's model.
        firmware: Major version of its firmware.
    """

    speed_sign = 15

    def __init__(self, model: SimulatedModel, firmware: int) -> None:
        super().__init__(model, firmware)
        self._is_sts = model.control == "sts"
        self._unsaved: dict[str, int] = {}  # EEPROM values before writes under the lock

    def start(self, ticks: float) -> None:
        """Initialise RAM at power-on, with the shaft at a tick; restore unsaved EEPROM values."""
        for name, value in self._unsaved.items():
            self[name] = value
        self._unsaved.clear()
        self["Goal Position"] = max(0, min(self.model.ticks - 1, round(ticks)))
        self["Moving Speed"] = 1000 if not self._is_sts else 3400  # the fastest
        if self._is_sts:
            self["Torque Limit"] = self["Max Torque"]

    def settings(self) -> DriveSettings:
        """Return the settings of the control loop."""
        low, high = self["Min Position Limit"], self["Max Position Limit"]
        is_motor = not self._is_sts and low == high == 0
        speed = self._speed()
        if not speed and not self["Phase"] & _ZERO_IS_FASTEST:
            speed = 1e-9  # the servo does not move
        has_positions = self.get("Operating Mode") == _POSITION and not is_motor
        return DriveSettings(
            torque=self["Torque Enable"] == 1 and has_positions,
            goal=self.angle(self._goal()),
            profile=Profile(speed, self.get("Acceleration") * _ACCELERATION),
            law=self._law(),
        )

    def refusal(self, register: Register, value: int) -> Denial | None:
        """See `Registers`."""
        if register.name == "Torque Enable" and value > 2:
            return Denial.RANGE
        return None

    def error_byte(self, refusal: Denial | None) -> int:
        """Return 0: the error byte concerns the servo only."""
        return 0

    def answers(self, is_read: bool) -> bool:
        """See `Registers`."""
        return is_read or self["Status Return Level"] == 1

    def enables_torque(self, names: Collection[str]) -> bool:
        """Return whether a goal is written to a servo without a fatal error (assumed)."""
        fatal = self["Hardware Error Status"] & self["Shutdown"]
        return "Goal Position" in names and not fatal and self["Torque Enable"] == 0

    def after_write(self, before: Mapping[str, int], drive: Drive) -> None:
        """See `Registers`."""
        if self["EEPROM Lock"]:
            for name, value in before.items():
                if self.table[name].eeprom:
                    self._unsaved.setdefault(name, value)
        else:
            for name in before:
                self._unsaved.pop(name, None)

    @property
    def _offset(self) -> int:
        return -from_sign_magnitude(self.get("Position Offset"), 11)

    def _goal(self) -> int:
        """Return the goal position, limited to the position limits, ticks."""
        goal = self["Goal Position"]
        if self._is_sts:
            goal = from_sign_magnitude(goal, 15)
        low, high = self["Min Position Limit"], self["Max Position Limit"]
        return goal if low >= high else max(low, min(high, goal))

    def _speed(self) -> float:
        """Return the goal speed, rad/s; 0: no limit."""
        count = self["Moving Speed"]
        if self._is_sts:
            count = round(abs(from_sign_magnitude(count, 15)) / _COARSE) * _COARSE
        return count * self.model.speed_unit

    def _law(self) -> ControlLaw:
        limit = self.get("Torque Limit", self["Max Torque"]) / 1000.0
        if self["Hardware Error Status"] & self.model.overload_error:
            limit = min(limit, self["Holding Torque"] / 100.0)
        gain = self["Position P Gain"]
        slope = _GAIN_SLOPE / gain if gain else math.inf
        return proportional_law(self.model.no_load_speed, slope, limit)
