"""Registers of a simulated servo: their bytes, which writes are accepted, and their effect.

Sources: ROBOTIS e-manual, page of each model: angle limits, control and operating modes, profiles,
gains, bus watchdog. Indirect Data are bytes without effect.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from enum import Enum
from typing import Final

from head_tracking.simulation.models import (
    RPM,
    Register,
    SimulatedModel,
    from_sign_magnitude,
    registers_of,
    to_sign_magnitude,
)
from head_tracking.simulation.motion import (
    ControlLaw,
    Drive,
    DriveSettings,
    Profile,
    compliance_law,
    proportional_law,
)

MX_ACCELERATION: Final = math.radians(8.583)
X_ACCELERATION: Final = 214.577 * RPM / 60.0
X_SPEED: Final = 0.229 * RPM
_SIGN: Final = 10  # bit of the sign of speed and load
_MX_GAIN_SLOPE: Final = 1024.0 * math.radians(300.0 / 1024.0)
"""Slope of a P Gain of 1, rad: slope 32 of an AX equals gain 32 of an MX (e-manual)."""

_REVERSE, _TIME_BASED, _TORQUE_BY_GOAL = 1, 4, 8  # bits of Drive Mode
_POSITION, _EXTENDED = 3, 4  # of Operating Mode; in the others the motor does not drive
_MODES: Final = (1, _POSITION, _EXTENDED, 16)
_CURRENT_MODES: Final = (0, 5)
_FULL_PWM: Final = 885
_X_GAIN: Final = 128.0  # Position P Gain of one count of PWM per tick
_GOALS: Final = ("Goal PWM", "Goal Current", "Goal Velocity", "Goal Position")
_LIMITS: Final = {
    "Goal PWM": "PWM Limit",
    "Goal Current": "Current Limit",
    "Goal Velocity": "Velocity Limit",
}
WATCHDOG_TRIPPED: Final = 255


class Denial(Enum):
    """Reason for refusing a packet: the error byte in protocol 1.0 and in protocol 2.0."""

    ACCESS = 8, 7  # no such register, or it cannot be written now
    LENGTH = 64, 5  # a part of a register, or a packet that is too short
    RANGE = 8, 4  # outside the range of the register
    LIMIT = 2, 6  # outside the limits that another register sets
    INSTRUCTION = 64, 2  # unknown instruction


class Registers:
    """Bytes of a control table, with the checks that a servo makes before it accepts a write.

    The subclasses `JointRegisters`, `XRegisters` and `FeetechRegisters` define the effect of the
    registers on the motion.

    Args:
        model: Model of the servo.
        firmware: Version of the firmware.

    Attributes:
        speed_register: Name of the register of the goal speed, in counts.
        speed_sign: Bit of the sign of Present Speed.
    """

    speed_register = "Moving Speed"
    speed_sign = _SIGN

    def __init__(self, model: SimulatedModel, firmware: int) -> None:
        self.model = model
        table = registers_of(model.name, firmware)
        self.table = {register.name: register for register in table}
        size = table[-1].end
        self._bytes = bytearray(size)
        self._values = {register.name: 0 for register in table}
        self._places = {r.name: (r.address, r.end, r.size, r.signed, r.order) for r in table}
        self._owners: list[Register | None] = [None] * size
        for register in table:
            self._owners[register.address : register.end] = [register] * register.size
        self.load_initial_values(eeprom=True)
        self.load_initial_values(eeprom=False)
        self["Firmware Version"] = firmware

    def load_initial_values(self, *, eeprom: bool) -> None:
        """Set the registers of EEPROM or of RAM to the values that the vendor states."""
        for register in self.table.values():
            if register.eeprom is eeprom and register.initial is not None:
                self[register.name] = register.initial

    def __getitem__(self, name: str) -> int:
        return self._values[name]

    def get(self, name: str, default: int = 0) -> int:
        """Return a register, or a default if the model does not have it."""
        return self._values.get(name, default)

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def __setitem__(self, name: str, value: int) -> None:
        """Set a register without checks."""
        if self._values[name] != value:
            start, end, size, signed, order = self._places[name]
            self._bytes[start:end] = value.to_bytes(size, order, signed=signed)
            self._values[name] = value

    def read(self, address: int, length: int) -> bytes | None:
        """Return bytes; None if some of them are beyond the table."""
        if length < 1 or address + length > len(self._bytes):
            return None
        return bytes(self._bytes[address : address + length])

    def changes(self, address: int, data: bytes) -> dict[str, int] | Denial:
        """Return the register values that a write would set, or the reason for refusing it."""
        if not data:
            return Denial.LENGTH
        changes: dict[str, int] = {}
        place, end = address, address + len(data)
        while place < end:
            register = self._owners[place] if place < len(self._owners) else None
            if register is None or not register.writable:
                return Denial.ACCESS
            share = data[place - address : register.end - address]
            if len(share) < register.size:
                return Denial.LENGTH
            value = register.decode(share)
            allowed = register.lowest <= value <= register.highest
            refusal = self.refusal(register, value) if allowed else Denial.RANGE
            if refusal:
                return refusal
            changes[register.name] = value
            place = register.end
        return changes

    def apply(self, changes: Mapping[str, int], drive: Drive) -> dict[str, int]:
        """Write values to registers, with all side effects; return the former values."""
        before = {name: self[name] for name in changes}
        for name, value in changes.items():
            self[name] = value
        if self.enables_torque(changes):
            before.setdefault("Torque Enable", self["Torque Enable"])
            self["Torque Enable"] = 1
        if any(self[name] != value for name, value in before.items()):
            self.after_write(before, drive)
        return before

    @property
    def first_measured(self) -> int:
        """Address of the first register that holds a measurement."""
        own = (r for r in self.table.values() if r.name.startswith(("Present", "Realtime Tick")))
        return min(register.address for register in own)

    def ticks(self, angle: float) -> float:
        """Return the position that the servo counts at an angle of the shaft, rad."""
        turned = self._direction * angle / self.model.radians_per_tick
        return self.model.center + turned + self._offset

    def angle(self, ticks: float) -> float:
        """Return the angle of the shaft, rad, at which the servo counts a position."""
        turned = ticks - self.model.center - self._offset
        return self._direction * turned * self.model.radians_per_tick

    def shut_down(self) -> bool:
        """Shut down because of an error; return whether torque was available before."""
        name = "Torque Enable" if "Hardware Error Status" in self else "Torque Limit"
        on = bool(self[name])
        self[name] = 0
        return on

    def answers(self, is_read: bool) -> bool:
        """Return whether the servo answers reads, or other instructions (except ping)."""
        return self["Status Return Level"] >= (1 if is_read else 2)

    def error_byte(self, refusal: Denial | None) -> int:
        """Return the bits of the error byte that concern the packet."""
        return 0 if refusal is None else refusal.value[self.model.protocol - 1]

    def refusal(self, register: Register, value: int) -> Denial | None:
        """Return the reason for refusing a value because of another register; None: accepted."""
        return None

    def after_write(self, before: Mapping[str, int], drive: Drive) -> None:
        """Apply the side effects of a write; `before` has the former values."""

    def enables_torque(self, names: Collection[str]) -> bool:
        """Return whether a write of these registers enables torque."""
        raise NotImplementedError

    def measure(self, drive: Drive, noise: float) -> None:
        """Set the measured registers; `noise` is that of the encoder, ticks."""
        model, sign = self.model, self._direction
        speed = round(sign * drive.speed / model.speed_unit)
        self["Present Position"] = self._in_range(self.ticks(drive.measured) + noise)
        self["Present Speed"] = to_sign_magnitude(speed, self.speed_sign)
        self["Present Load"] = to_sign_magnitude(
            round(sign * drive.output * model.load_maximum), _SIGN
        )
        self["Moving"] = int(drive.moving)

    def reset_turns(self, drive: Drive) -> None:
        """Reset the count of turns, if the model has one."""

    def _in_range(self, ticks: float) -> int:
        """Return the tick that an encoder without a count of turns reads."""
        if self.model.endless:
            return round(ticks) % self.model.ticks
        return max(0, min(self.model.ticks - 1, round(ticks)))

    @property
    def _offset(self) -> int:
        """Offset that the servo adds to its position, ticks."""
        return 0

    @property
    def _direction(self) -> int:
        return -1 if self.get("Drive Mode") & _REVERSE else 1


class JointRegisters(Registers):
    """AX, RX, MX with protocol 1.0, and XL-320; the angle limits select joint or wheel mode."""

    def start(self, ticks: float) -> None:
        """Initialise RAM at power-on, with the shaft at a tick."""
        self["Goal Position"] = self._in_range(ticks)
        self["Torque Limit"] = self["Max Torque"]

    def settings(self) -> DriveSettings:
        """Return the settings of the control loop."""
        speed = from_sign_magnitude(self["Moving Speed"], _SIGN)
        ramp = self.get("Goal Acceleration") * MX_ACCELERATION
        return DriveSettings(
            torque=bool(self["Torque Enable"]),
            goal=self.angle(self["Goal Position"]),
            profile=Profile(abs(speed) * self.model.speed_unit, ramp),
            law=self._law(),
            governed=True,
            output=speed / self.model.speed_maximum if self._is_wheel else None,
        )

    def refusal(self, register: Register, value: int) -> Denial | None:
        """See `Registers`."""
        if register.name == "Lock" and value < self["Lock"]:
            return Denial.ACCESS  # only a power cycle unlocks
        if register.eeprom and self.get("Lock"):
            return Denial.ACCESS
        if self._is_wheel:
            return None
        if register.name == "Moving Speed" and value > self.model.speed_maximum:
            return Denial.RANGE
        if register.name == "Goal Position":
            if not 0 <= value < self.model.ticks:
                return Denial.RANGE
            if not self["CW Angle Limit"] <= value <= self["CCW Angle Limit"]:
                return Denial.LIMIT
        return None

    def enables_torque(self, names: Collection[str]) -> bool:
        """Return whether a goal or a speed is written (reported by users)."""
        return "Goal Position" in names or "Moving Speed" in names

    @property
    def _is_wheel(self) -> bool:
        if "Control Mode" in self:
            return self["Control Mode"] == 1
        return self["CW Angle Limit"] == self["CCW Angle Limit"] == 0

    def _law(self) -> ControlLaw:
        punch, limit = self["Punch"] / 1023.0, self["Torque Limit"] / 1023.0
        if "P Gain" in self:
            gain = self["P Gain"]
            slope = _MX_GAIN_SLOPE / gain if gain else math.inf
            return proportional_law(self.model.no_load_speed, slope, limit, punch)
        return compliance_law(
            self.model.radians_per_tick,
            (self["CW Compliance Margin"], self["CCW Compliance Margin"]),
            (self["CW Compliance Slope"], self["CCW Compliance Slope"]),
            punch,
            limit,
        )


class XRegisters(Registers):
    """X series and MX(2.0): profiles of velocity; modes without goal positions do not drive."""

    speed_register = "Profile Velocity"

    def start(self, ticks: float) -> None:
        """Initialise RAM at power-on, with the shaft at a tick."""
        self["Goal Position"] = round(ticks)
        self._reset_goals()
        if "Startup Configuration" in self:
            self["Torque Enable"] = self["Startup Configuration"] & 1

    def settings(self) -> DriveSettings:
        """Return the settings of the control loop."""
        limit = min(self["PWM Limit"], abs(self["Goal PWM"])) / _FULL_PWM
        gain = self["Position P Gain"] / _X_GAIN
        slope = _FULL_PWM / gain * self.model.radians_per_tick if gain else math.inf
        has_positions = self["Operating Mode"] in (_POSITION, _EXTENDED)
        in_rpm = not self["Drive Mode"] & _TIME_BASED
        fastest, speed = self["Velocity Limit"], self["Profile Velocity"]
        return DriveSettings(
            torque=bool(self["Torque Enable"]) and has_positions and in_rpm,
            goal=self.angle(self["Goal Position"]),
            profile=Profile(
                min(fastest, speed) * X_SPEED, self["Profile Acceleration"] * X_ACCELERATION
            ),
            law=proportional_law(self.model.no_load_speed, slope, limit),
        )

    def refusal(self, register: Register, value: int) -> Denial | None:
        """See `Registers`."""
        name = register.name
        if register.eeprom and self["Torque Enable"]:
            return Denial.ACCESS
        if name == "Operating Mode":
            modes = _MODES + (_CURRENT_MODES if "Present Current" in self else ())
            return None if value in modes else Denial.RANGE
        if name in _GOALS and self.get("Bus Watchdog") == WATCHDOG_TRIPPED:
            return Denial.RANGE
        if name in _LIMITS and abs(value) > self[_LIMITS[name]]:
            return Denial.LIMIT
        low, high = self["Min Position Limit"], self["Max Position Limit"]
        limited = name == "Goal Position" and self["Operating Mode"] == _POSITION
        return Denial.LIMIT if limited and not low <= value <= high else None

    def enables_torque(self, names: Collection[str]) -> bool:
        """Return whether a goal is written and Drive Mode enables torque by goals."""
        return bool(self["Drive Mode"] & _TORQUE_BY_GOAL) and any(n in _GOALS for n in names)

    def after_write(self, before: Mapping[str, int], drive: Drive) -> None:
        """See `Registers`."""
        if before.get("Operating Mode", self["Operating Mode"]) != self["Operating Mode"]:
            self._reset_goals()
            self.reset_turns(drive)
        switched_on = self["Torque Enable"] and not before.get("Torque Enable", 1)
        if switched_on and self["Operating Mode"] == _POSITION:
            self.reset_turns(drive)

    def measure(self, drive: Drive, noise: float) -> None:
        """Set the measured registers; `noise` is that of the encoder, ticks."""
        model, sign = self.model, self._direction
        velocity = round(sign * drive.speed / X_SPEED)
        self["Present Position"] = round(self.ticks(drive.angle) + noise)
        self["Present Velocity"] = velocity
        if "Present Current" in self:
            self["Present Current"] = round(sign * drive.current * model.load_maximum)
        else:
            self["Present Load"] = round(sign * drive.output * model.load_maximum)
        self["Velocity Trajectory"] = round(sign * drive.reference_speed / X_SPEED)
        self["Moving"] = int(drive.approaching or abs(velocity) > self["Moving Threshold"])

    def reset_turns(self, drive: Drive) -> None:
        """See `Registers`."""
        turns = math.floor(self.ticks(drive.angle) / self.model.ticks)
        drive.subtract_turns(self._direction * turns)

    def hold(self, drive: Drive) -> None:
        """Stop at the present position because the bus watchdog has tripped."""
        self["Bus Watchdog"] = WATCHDOG_TRIPPED
        self["Goal Velocity"] = 0
        self["Goal PWM"] = self["PWM Limit"]
        self["Goal Position"] = round(self.ticks(drive.angle))

    def _reset_goals(self) -> None:
        self["Goal PWM"] = self["PWM Limit"]
        self["Goal Velocity"] = self["Velocity Limit"]
        if "Goal Current" in self:
            self["Goal Current"] = self["Current Limit"]

    @property
    def _offset(self) -> int:
        offset = self["Homing Offset"]
        if self["Operating Mode"] == _POSITION:
            return max(-1024, min(1024, offset))
        return offset
