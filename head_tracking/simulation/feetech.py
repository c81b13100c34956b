"""What the registers of simulated Feetech servos mean, and the instructions that only they know.

Packets are those of Dynamixel protocol 1.0 (`packets`), which Feetech took over; instructions,
byte order, signs and registers are Feetech's. Sources: ftservo-wiki 9522ce1, ft-scs.md,
memory-sts.md and memory-scscl.md. What is marked "assumed" is not in them:

- a goal switches torque on, because programs of others never write Torque Enable (assumed);
- a write that a servo cannot obey is answered as any other, and changes nothing (assumed);
- an overload lasts until a restart (assumed); a servo that does not switch itself off because of
  it drives with its Holding Torque.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Final

from head_tracking.simulation.models import Register, SimulatedModel
from head_tracking.simulation.motion import (
    Control,
    ControlLaw,
    Drive,
    DriveSettings,
    Profile,
    proportional_law,
)
from head_tracking.simulation.registers import Refusal, Registers

REG_WRITE, ACTION, RESTORE, RESTART, BACK_UP, RESET_TURNS, CALIBRATE = 4, 5, 6, 8, 9, 10, 11
"""Codes of instructions."""

_FAST_UNITS, _ZERO_IS_FASTEST, _COUNTS_TURNS = 4, 8, 16  # bits of Phase; the first: steps/s
_COARSE: Final = 50  # steps/s: 0.732 rpm, the precision of a speed of an STS servo
_ACCELERATION: Final = math.radians(8.7)
_GAIN_SLOPE: Final = math.radians(160.0)
"""Slope of a P gain of 1, rad: with 32, half of the stall torque is 2.5 degrees off
(TheRobotStudio/SO-ARM100 issue 134: 1.8 to 2.6)."""

_POSITION, _SPEED, _PWM = 0, 1, 2  # of Operating Mode
_CALIBRATE_HERE: Final = 128  # of Torque Enable
_CURRENT_UNIT: Final = 0.0065  # A
_STALL_CURRENT: Final = 2.7  # A


def to_sign_magnitude(value: int, bit: int) -> int:
    """Return a number with its sign in a bit; what does not fit is cut off."""
    magnitude = min(abs(value), (1 << bit) - 1)
    return magnitude | 1 << bit if value < 0 else magnitude


def from_sign_magnitude(raw: int, bit: int) -> int:
    """Return the number whose sign is in a bit."""
    magnitude = raw & (1 << bit) - 1
    return -magnitude if raw >> bit & 1 else magnitude


class FeetechRegisters(Registers):
    """STS and SCS servos.

    Args:
        model: The servo's model.
        firmware: Major version of its firmware.
    """

    def __init__(self, model: SimulatedModel, firmware: int) -> None:
        super().__init__(model, firmware)
        self._is_sts = model.control == "sts"
        self._unlocked: dict[str, int] = {}  # what power-off brings back: written under the lock
        self._back_up: dict[str, int] = {}
        self._later: tuple[int, bytes] | None = None  # of the last REG_WRITE

    @property
    def goal_speed(self) -> int:
        """Speed at which a goal is approached, in its counts."""
        return self["Moving Speed"]

    def start(self, ticks: float) -> None:
        """Set what power-on sets, with the shaft at a tick."""
        for name, value in self._unlocked.items():
            self[name] = value
        self._unlocked.clear()
        self["Goal Position"] = max(0, min(self.model.ticks - 1, round(ticks)))
        self["Moving Speed"] = 1000 if not self._is_sts else 3400  # its fastest
        if self._is_sts:
            self["Torque Limit"] = self["Max Torque"]

    def settings(self) -> DriveSettings:
        """Return what the control loop must know."""
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
        """See `Registers`; gaps between registers take anything."""
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
        """Return 0: the error byte tells of the servo only."""
        return 0

    def answers(self, is_read: bool) -> bool:
        """See `Registers`."""
        return is_read or self["Status Return Level"] == 1

    def stiffens(self, names: Collection[str]) -> bool:
        """Return whether a write of these registers switches torque on (assumed)."""
        fatal = self["Hardware Error Status"] & self["Shutdown"]
        return "Goal Position" in names and not fatal and self["Torque Enable"] == 0

    def shut_down(self) -> bool:
        """Switch torque off because of an error; return whether it was on."""
        on = bool(self["Torque Enable"])
        self["Torque Enable"] = 0
        return on

    def written(self, before: Mapping[str, int], drive: Drive) -> None:
        """See `Registers`."""
        if self["EEPROM Lock"]:
            for name, value in before.items():
                if self.table[name].eeprom:
                    self._unlocked.setdefault(name, value)
        else:
            for name in before:
                self._unlocked.pop(name, None)
        if self["Torque Enable"] == _CALIBRATE_HERE:
            self["Torque Enable"] = before["Torque Enable"]
            self._calibrate(self.model.center, drive)

    def carry_out(self, code: int, parameters: bytes, drive: Drive) -> bool:
        """See `Registers`."""
        if code == REG_WRITE and len(parameters) >= 2:
            self._later = parameters[0], parameters[1:]
            self["Registered"] = 1
        elif code == ACTION:
            self._act(drive)
        elif code == BACK_UP:
            self._back_up = {r.name: self[r.name] for r in self.table.values() if r.eeprom}
        elif code == RESTORE:
            kept = {name: value for name, value in self._back_up.items() if name != "ID"}
            for name, value in kept.items():
                self[name] = value
        elif code == RESET_TURNS:
            drive.turn_back(math.floor(drive.angle / (2.0 * math.pi) + 0.5))
        elif code == CALIBRATE and self._is_sts:
            wanted = int.from_bytes(parameters, "little") if parameters else self.model.center
            self._calibrate(wanted, drive)
        else:
            return False
        return True

    def measure(self, drive: Drive, noise: float) -> None:
        """Take over what the servo measures; `noise` is the encoder's, ticks."""
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
        """Return the goal within the servo's own limits, ticks."""
        goal = self["Goal Position"]
        if self._is_sts:
            goal = from_sign_magnitude(goal, 15)
        low, high = self["Min Position Limit"], self["Max Position Limit"]
        return goal if low >= high else max(low, min(high, goal))

    def _angle(self, ticks: int) -> float:
        return (ticks - self._offset - self.model.center) * self.model.radians_per_tick

    def _in_range(self, ticks: float) -> int:
        if self.model.endless:
            return round(ticks) % self.model.ticks
        return max(0, min(self.model.ticks - 1, round(ticks)))

    def _speed(self) -> float:
        """Return the goal speed, rad/s; 0 for no limit."""
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
            speed = 1e-9  # it stands
        return Profile(speed, self.get("Acceleration") * _ACCELERATION)

    def _law(self) -> ControlLaw:
        limit = self.get("Torque Limit", self["Max Torque"]) / 1000.0
        if self["Hardware Error Status"] & self.model.overload_error:
            limit = min(limit, self["Holding Torque"] / 100.0)
        gain = self["Position P Gain"]
        slope = _GAIN_SLOPE / gain if gain else math.inf
        return proportional_law(self.model.no_load_speed, slope, limit)

    def _calibrate(self, wanted: int, drive: Drive) -> None:
        """Choose the offset that makes the present position another."""
        turn = self.model.ticks
        offset = round(self.ticks(drive.measured)) - self._offset - wanted
        offset = (offset + turn // 2) % turn - turn // 2
        self["Position Offset"] = to_sign_magnitude(offset, 11)

    def _act(self, drive: Drive) -> None:
        later, self._later = self._later, None
        self["Registered"] = 0
        if later is None:
            return
        changes = self.changes(*later)
        if isinstance(changes, Refusal):
            return
        before = {name: self[name] for name in changes}
        for name, value in changes.items():
            self[name] = value
        if self.stiffens(changes):
            before.setdefault("Torque Enable", self["Torque Enable"])
            self["Torque Enable"] = 1
        self.written(before, drive)
