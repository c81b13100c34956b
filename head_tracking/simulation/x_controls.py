"""What the registers of X series and MX(2.0) mean for the motion, and the way back.

Source: ROBOTIS e-manual, pages of the X series: operating modes, profiles, gains, bus watchdog.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Final

from head_tracking.dynamixel.control_table import X_ACCELERATION, X_SPEED, Memory, Register
from head_tracking.dynamixel.models import ServoModel
from head_tracking.simulation.compliance import ComplianceLaw
from head_tracking.simulation.drive import Control, Drive, DriveSettings
from head_tracking.simulation.memory import Refusal, RegisterMemory
from head_tracking.simulation.setpoint import Profile

_REVERSE, _TIME_BASED, _TORQUE_BY_GOAL = 1, 4, 8
_CURRENT, _VELOCITY, _POSITION, _EXTENDED, _CURRENT_POSITION, _PWM = 0, 1, 3, 4, 5, 16
_FULL_PWM: Final = 885
_GAIN: Final = 128.0  # of a Position P Gain that gives one count of PWM for each tick
_GOALS: Final = ("Goal PWM", "Goal Current", "Goal Velocity", "Goal Position")
_LIMITS: Final = {
    "Goal PWM": "PWM Limit",
    "Goal Current": "Current Limit",
    "Goal Velocity": "Velocity Limit",
}
WATCHDOG_TRIPPED: Final = 255


class XControls:
    """Operating modes and profiles; see `Controls` for the methods.

    Args:
        model: The model.
    """

    def __init__(self, model: ServoModel) -> None:
        self._model = model
        self._effort = "Present Current" if "Present Current" in model.control_table else ""

    def start(self, memory: RegisterMemory, ticks: float) -> None:
        """See `Controls`."""
        memory["Goal Position"] = round(ticks)
        self._reset_goals(memory)
        if "Startup Configuration" in memory:
            memory["Torque Enable"] = memory["Startup Configuration"] & 1

    def settings(self, memory: RegisterMemory) -> DriveSettings:
        """See `Controls`."""
        mode, sign = memory["Operating Mode"], self._direction(memory)
        full = self._model.load_maximum
        if mode == _VELOCITY:
            control, goal = Control.VELOCITY, sign * memory["Goal Velocity"] * X_SPEED
        elif mode == _PWM:
            control, goal = Control.OUTPUT, sign * memory["Goal PWM"] / _FULL_PWM
        elif mode == _CURRENT:
            control, goal = Control.OUTPUT, sign * memory["Goal Current"] / full
        else:
            control, goal = Control.POSITION, self._angle(memory, memory["Goal Position"])
        limit = memory["PWM Limit"] / _FULL_PWM
        if mode in (_VELOCITY, _POSITION, _EXTENDED, _CURRENT_POSITION):
            limit = min(limit, abs(memory["Goal PWM"]) / _FULL_PWM)
        if mode == _CURRENT_POSITION:
            limit = min(limit, abs(memory["Goal Current"]) / full)
        return DriveSettings(
            torque=bool(memory["Torque Enable"]),
            control=control,
            goal=goal,
            profile=self._profile(memory, goal if mode == _VELOCITY else 0.0),
            law=self._law(memory, limit),
        )

    def ticks(self, memory: RegisterMemory, angle: float) -> float:
        """See `Controls`."""
        turned = self._direction(memory) * angle / self._model.radians_per_tick
        return self._model.center + turned + self._offset(memory)

    def refusal(self, memory: RegisterMemory, register: Register, value: int) -> Refusal | None:
        """See `Controls`."""
        name = register.name
        if register.memory is Memory.EEPROM and memory["Torque Enable"]:
            return Refusal.LOCKED
        if name == "Operating Mode":
            modes = [_VELOCITY, _POSITION, _EXTENDED, _PWM]
            modes += [_CURRENT, _CURRENT_POSITION] if self._effort else []
            return None if value in modes else Refusal.RANGE
        if name in _GOALS and memory["Bus Watchdog"] == WATCHDOG_TRIPPED:
            return Refusal.RANGE
        if name in _LIMITS and abs(value) > memory[_LIMITS[name]]:
            return Refusal.LIMIT
        if name == "Goal Position" and memory["Operating Mode"] == _POSITION:
            low, high = memory["Min Position Limit"], memory["Max Position Limit"]
            return None if low <= value <= high else Refusal.LIMIT
        return None

    def stiffens(self, memory: RegisterMemory, names: Collection[str]) -> bool:
        """See `Controls`."""
        return bool(memory["Drive Mode"] & _TORQUE_BY_GOAL) and any(n in _GOALS for n in names)

    def written(self, memory: RegisterMemory, before: Mapping[str, int], drive: Drive) -> None:
        """See `Controls`."""
        if before.get("Operating Mode", memory["Operating Mode"]) != memory["Operating Mode"]:
            self._reset_goals(memory)
            self.fold(memory, drive)
        switched_on = memory["Torque Enable"] and not before.get("Torque Enable", 1)
        if switched_on and memory["Operating Mode"] == _POSITION:
            self.fold(memory, drive)

    def refresh(self, memory: RegisterMemory, drive: Drive, noise: float) -> None:
        """See `Controls`."""
        model, sign = self._model, self._direction(memory)
        shaft, setpoint = drive.shaft, drive.setpoint
        velocity = round(sign * shaft.speed / X_SPEED)
        memory["Present Position"] = round(self.ticks(memory, shaft.angle) + noise)
        memory["Present Velocity"] = velocity
        memory["Present PWM"] = round(sign * drive.output * _FULL_PWM)
        if self._effort:
            memory[self._effort] = round(sign * drive.current * model.load_maximum)
        else:
            memory["Present Load"] = round(sign * drive.output * model.load_maximum)
        memory["Velocity Trajectory"] = round(sign * setpoint.speed / X_SPEED)
        memory["Position Trajectory"] = round(self.ticks(memory, setpoint.angle))
        on_the_way = drive.approaching
        moving = on_the_way or abs(velocity) > memory["Moving Threshold"]
        memory["Moving"] = int(moving)
        memory["Moving Status"] = (not drive.moving) | on_the_way << 1 | self._form(memory) << 4

    def shut_down(self, memory: RegisterMemory) -> bool:
        """See `Controls`."""
        on = bool(memory["Torque Enable"])
        memory["Torque Enable"] = 0
        return on

    def fold(self, memory: RegisterMemory, drive: Drive) -> None:
        """Count the present position within one turn from now on."""
        turns = math.floor(self.ticks(memory, drive.shaft.angle) / self._model.ticks)
        drive.turn_back(self._direction(memory) * turns)

    def hold(self, memory: RegisterMemory, drive: Drive) -> None:
        """Stop where the shaft stands: the watchdog has tripped."""
        memory["Bus Watchdog"] = WATCHDOG_TRIPPED
        memory["Goal Velocity"] = memory["Goal PWM"] = 0
        if memory["Operating Mode"] != _PWM:
            memory["Goal PWM"] = memory["PWM Limit"]
        memory["Goal Position"] = round(self.ticks(memory, drive.shaft.angle))

    def _reset_goals(self, memory: RegisterMemory) -> None:
        mode = memory["Operating Mode"]
        memory["Goal PWM"] = 0 if mode == _PWM else memory["PWM Limit"]
        memory["Goal Velocity"] = 0 if mode == _VELOCITY else memory["Velocity Limit"]
        if "Goal Current" in memory:
            memory["Goal Current"] = 0 if mode == _CURRENT else memory["Current Limit"]

    def _profile(self, memory: RegisterMemory, velocity: float) -> Profile:
        fastest = memory["Velocity Limit"] * X_SPEED
        speed, ramp = memory["Profile Velocity"], memory["Profile Acceleration"]
        if not memory["Drive Mode"] & _TIME_BASED:
            return Profile(min(fastest, speed * X_SPEED), ramp * X_ACCELERATION)
        if velocity:
            return Profile(fastest, abs(velocity) / (ramp * 1e-3) if ramp else 0.0)
        return Profile(fastest if speed else 0.0, 0.0, speed * 1e-3, ramp * 1e-3)

    def _form(self, memory: RegisterMemory) -> int:
        """Return the kind of profile as Moving Status tells it: step, rectangle, trapezoid."""
        if not memory["Profile Velocity"]:
            return 0
        return 3 if memory["Profile Acceleration"] else 1

    def _law(self, memory: RegisterMemory, limit: float) -> ComplianceLaw:
        gain = memory["Position P Gain"] / _GAIN
        slope = _FULL_PWM / gain * self._model.radians_per_tick if gain else math.inf
        return ComplianceLaw.proportional(self._model, slope, limit)

    def _direction(self, memory: RegisterMemory) -> int:
        return -1 if memory["Drive Mode"] & _REVERSE else 1

    def _offset(self, memory: RegisterMemory) -> int:
        offset = memory["Homing Offset"]
        if memory["Operating Mode"] in (_POSITION, _VELOCITY):
            return max(-1024, min(1024, offset))
        return offset

    def _angle(self, memory: RegisterMemory, ticks: int) -> float:
        turned = ticks - self._model.center - self._offset(memory)
        return self._direction(memory) * turned * self._model.radians_per_tick
