"""Registers and instructions of simulated Feetech servos.

Packets have the format of Dynamixel protocol 1.0 (`packets`); instructions, byte order, signs and
registers are Feetech's. Sources: ftservo-wiki 9522ce1, ft-scs.md, memory-sts.md, memory-scscl.md.
Assumptions that these sources do not confirm:

- a goal enables torque, because other programs never write Torque Enable;
- a write that a servo cannot obey is answered without an error, and changes nothing;
- an overload lasts until a restart; a servo that it does not shut down uses its Holding Torque.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Final

from head_tracking.simulation.models import (
    Register,
    SimulatedModel,
    from_sign_magnitude,
    to_sign_magnitude,
)
from head_tracking.simulation.motion import (
    Control,
    ControlLaw,
    Drive,
    DriveSettings,
    Profile,
    proportional_law,
)
from head_tracking.simulation.registers import Refusal, Registers

REG_WRITE, ACTION, RESTART, CALIBRATE = 4, 5, 8, 11
"""Instruction codes."""

_FAST_UNITS, _ZERO_IS_FASTEST, _COUNTS_TURNS = 4, 8, 16  # bits of Phase; _FAST_UNITS: steps/s
_COARSE: Final = 50  # steps/s: 0.732 rpm, the precision of a speed of an STS servo
_ACCELERATION: Final = math.radians(8.7)
_GAIN_SLOPE: Final = math.radians(160.0)
"""Slope of a P gain of 1, rad: with 32, half of the stall torque is 2.5 degrees off
(TheRobotStudio/SO-ARM100 issue 134: 1.8 to 2.6)."""

_POSITION, _SPEED, _PWM = 0, 1, 2  # of Operating Mode
_CALIBRATE_HERE: Final = 128  # of Torque Enable
_CURRENT_UNIT: Final = 0.0065  # A
_STALL_CURRENT: Final = 2.7  # A


class FeetechRegisters(Registers):
    """STS and SCS servos.

    Args:
        model: The servo's model.
        firmware: Major version of its firmware.
    """

    def __init__(self, model: SimulatedModel, firmware: int) -> None:
        super().__init__(model, firmware)
        self._is_sts = model.control == "sts"
        self._unsaved: dict[str, int] = {}  # EEPROM values before writes under the lock
        self._registered: tuple[int, bytes] | None = None  # address and data of the last REG_WRITE

    @property
    def goal_speed(self) -> int:
        """Profile speed of the goal position, in counts."""
        return self["Moving Speed"]

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
        mode = self.get("Operating Mode")
        speed = self._speed()
        control, goal = Control.POSITION, self._angle(self._goal())
        if mode == _SPEED:
            control, goal = Control.VELOCITY, speed
        elif mode == _PWM or self._is_motor:
            control = Control.OUTPUT
            goal = from_sign_magnitude(self["Goal Time"], 10) / 1000.0
        return DriveSettings(
            torque=self["Torque Enable"] == 1,
            control=control,
            goal=goal,
            profile=self._profile(abs(speed)),
            law=self._law(),
        )

    def changes(self, address: int, data: bytes) -> dict[str, int] | Refusal:
        """See `Registers`; writes to gaps between registers are ignored."""
        changes: dict[str, int] = {}
        place, end = address, address + len(data)
        while place < end:
            register = self._owners[place] if place < len(self._owners) else None
            if register is None:
                place += 1
                continue
            share = data[place - address : register.end - address]
            found = super().changes(place, share)
            if isinstance(found, Refusal):
                return found
            changes |= found
            place = register.end
        return changes if data else Refusal.LENGTH

    def refusal(self, register: Register, value: int) -> Refusal | None:
        """See `Registers`."""
        if register.name == "Torque Enable" and 2 < value != _CALIBRATE_HERE:
            return Refusal.RANGE
        return None

    def error_byte(self, refusal: Refusal | None) -> int:
        """Return 0: the error byte concerns the servo only."""
        return 0

    def answers(self, is_read: bool) -> bool:
        """See `Registers`."""
        return is_read or self["Status Return Level"] == 1

    def enables_torque(self, names: Collection[str]) -> bool:
        """Return whether a goal is written to a servo without a fatal error (assumed)."""
        fatal = self["Hardware Error Status"] & self["Shutdown"]
        return "Goal Position" in names and not fatal and self["Torque Enable"] == 0

    def shut_down(self) -> bool:
        """Disable torque because of an error; return whether it was enabled."""
        on = bool(self["Torque Enable"])
        self["Torque Enable"] = 0
        return on

    def after_write(self, before: Mapping[str, int], drive: Drive) -> None:
        """See `Registers`."""
        if self["EEPROM Lock"]:
            for name, value in before.items():
                if self.table[name].eeprom:
                    self._unsaved.setdefault(name, value)
        else:
            for name in before:
                self._unsaved.pop(name, None)
        if self["Torque Enable"] == _CALIBRATE_HERE:
            self["Torque Enable"] = before["Torque Enable"]
            self._calibrate(self.model.center, drive)

    def execute(self, code: int, parameters: bytes, drive: Drive) -> bool:
        """See `Registers`."""
        if code == REG_WRITE and len(parameters) >= 2:
            self._registered = parameters[0], parameters[1:]
            self["Registered"] = 1
        elif code == ACTION:
            changes = self.changes(*self._registered) if self._registered else {}
            self._registered, self["Registered"] = None, 0
            if not isinstance(changes, Refusal):
                self.apply(changes, drive)
        elif code == CALIBRATE and self._is_sts:
            wanted = int.from_bytes(parameters, "little") if parameters else self.model.center
            self._calibrate(wanted, drive)
        else:
            return False
        return True

    def measure(self, drive: Drive, noise: float) -> None:
        """Set the measured registers; `noise` is that of the encoder, ticks."""
        model = self.model
        if self._counts_turns:
            turned = round(self.ticks(drive.angle) + noise)
            self["Present Position"] = to_sign_magnitude(turned, 15)
        else:
            self["Present Position"] = self._in_range(self.ticks(drive.measured) + noise)
        speed = round(drive.speed / model.speed_unit)
        if self._is_sts and not self["Phase"] & _FAST_UNITS:
            speed = round(speed / _COARSE)
        self["Present Speed"] = to_sign_magnitude(speed, 15)
        self["Present Load"] = to_sign_magnitude(round(drive.output * model.load_maximum), 10)
        self["Moving"] = int(drive.moving)
        if self._is_sts:
            current = abs(drive.current) * _STALL_CURRENT / _CURRENT_UNIT
            self["Present Current"] = round(current)
            self["Goal in Effect"] = to_sign_magnitude(self._goal(), 15)

    @property
    def _is_motor(self) -> bool:
        low, high = self["Min Position Limit"], self["Max Position Limit"]
        return not self._is_sts and low == high == 0

    @property
    def _counts_turns(self) -> bool:
        return self._is_sts and bool(self["Phase"] & _COUNTS_TURNS)

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

    def _angle(self, ticks: int) -> float:
        return (ticks - self._offset - self.model.center) * self.model.radians_per_tick

    def _speed(self) -> float:
        """Return the goal speed, rad/s; 0: no limit."""
        count = self["Moving Speed"]
        if not self._is_sts:
            return count * self.model.speed_unit
        count = from_sign_magnitude(count, 15)
        steps = round(count / _COARSE) if self["Phase"] & _FAST_UNITS else count
        return steps * _COARSE * self.model.speed_unit

    def _profile(self, speed: float) -> Profile:
        if not speed and not self._is_sts and self["Goal Time"] and not self._is_motor:
            return Profile(0.0, 0.0, self["Goal Time"] * 1e-3)
        if not speed and not self["Phase"] & _ZERO_IS_FASTEST:
            speed = 1e-9  # the servo does not move
        return Profile(speed, self.get("Acceleration") * _ACCELERATION)

    def _law(self) -> ControlLaw:
        limit = self.get("Torque Limit", self["Max Torque"]) / 1000.0
        if self["Hardware Error Status"] & self.model.overload_error:
            limit = min(limit, self["Holding Torque"] / 100.0)
        gain = self["Position P Gain"]
        slope = _GAIN_SLOPE / gain if gain else math.inf
        return proportional_law(self.model.no_load_speed, slope, limit)

    def _calibrate(self, wanted: int, drive: Drive) -> None:
        """Set the offset so that the present position becomes the wanted one, ticks."""
        turn = self.model.ticks
        offset = round(self.ticks(drive.measured)) - self._offset - wanted
        offset = (offset + turn // 2) % turn - turn // 2
        self["Position Offset"] = to_sign_magnitude(offset, 11)
