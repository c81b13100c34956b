"""What the registers of AX, MX (protocol 1.0) and XL-320 mean for the motion, and the way back."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Final, Protocol

from head_tracking.dynamixel.control_table import (
    MX_ACCELERATION,
    Memory,
    Register,
    decode_sign_magnitude,
    encode_sign_magnitude,
)
from head_tracking.dynamixel.models import ServoModel
from head_tracking.simulation.compliance import AX_DAMPING, ComplianceLaw, Side, slope_ticks
from head_tracking.simulation.drive import Control, Drive, DriveSettings
from head_tracking.simulation.memory import Refusal, RegisterMemory
from head_tracking.simulation.setpoint import Profile

_GAIN_SLOPE: Final = 1024.0 * math.radians(300.0 / 1024.0)
"""Slope of a P Gain of 1, rad: slope 32 of an AX and gain 32 of an MX do the same (e-manual)."""
_STALL: Final = 911  # counts of the Current register at stall: 4.1 A
_HIGHEST: Final = 1023


class Controls(Protocol):
    """The registers of a family of servos."""

    def start(self, memory: RegisterMemory, ticks: float) -> None:
        """Set what power-on sets, with the shaft at a tick."""

    def settings(self, memory: RegisterMemory) -> DriveSettings:
        """Return what the control loop must know."""

    def ticks(self, memory: RegisterMemory, angle: float) -> float:
        """Return the position of the shaft at an angle, rad, as the servo counts it."""

    def refusal(self, memory: RegisterMemory, register: Register, value: int) -> Refusal | None:
        """Return why another register forbids a value."""

    def stiffens(self, memory: RegisterMemory, names: Collection[str]) -> bool:
        """Return whether a write of these registers may switch torque on."""

    def written(self, memory: RegisterMemory, before: Mapping[str, int], drive: Drive) -> None:
        """Do what a write does besides; `before` has the old values of what was written."""

    def refresh(self, memory: RegisterMemory, drive: Drive, noise: float) -> None:
        """Write what the servo measures into its registers; `noise` is the encoder's, ticks."""

    def shut_down(self, memory: RegisterMemory) -> bool:
        """Switch off because of an error; return whether something was on."""


class JointControls:
    """Joint, wheel and multi-turn mode by angle limits; a moving speed.

    Args:
        model: The model.
    """

    def __init__(self, model: ServoModel) -> None:
        self._model = model

    def start(self, memory: RegisterMemory, ticks: float) -> None:
        """See `Controls`."""
        memory["Goal Position"] = self._in_range(memory, ticks)
        memory["Torque Limit"] = memory["Max Torque"]

    def settings(self, memory: RegisterMemory) -> DriveSettings:
        """See `Controls`."""
        model = self._model
        speed = memory["Moving Speed"]
        wheel = self._is_wheel(memory)
        control, goal = Control.POSITION, self._angle(memory, memory["Goal Position"])
        if memory.get("Torque Ctrl Mode Enable"):
            control, goal = Control.OUTPUT, decode_sign_magnitude(memory["Goal Torque"]) / _STALL
        elif wheel and model.endless:
            control, goal = Control.VELOCITY, decode_sign_magnitude(speed) * model.speed_unit
        elif wheel:
            control, goal = Control.OUTPUT, decode_sign_magnitude(speed) / model.speed_maximum
        ramp = memory.get("Goal Acceleration", 0)
        return DriveSettings(
            torque=bool(memory["Torque Enable"]),
            control=control,
            goal=goal,
            profile=Profile((speed & _HIGHEST) * model.speed_unit, ramp * MX_ACCELERATION),
            law=self._law(memory),
            round=wheel or (model.endless and not self._is_multi_turn(memory)),
            governed=True,
        )

    def ticks(self, memory: RegisterMemory, angle: float) -> float:
        """See `Controls`."""
        turned = self._direction(memory) * angle / self._model.radians_per_tick
        offset = memory["Multi Turn Offset"] if self._is_multi_turn(memory) else 0
        return self._model.center + turned + offset

    def refusal(self, memory: RegisterMemory, register: Register, value: int) -> Refusal | None:
        """See `Controls`."""
        if register.name == "Lock" and value < memory["Lock"]:
            return Refusal.LOCKED  # only a power cycle unlocks
        if register.memory is Memory.EEPROM and memory.get("Lock"):
            return Refusal.LOCKED
        if self._is_wheel(memory) or self._is_multi_turn(memory):
            return None
        if register.name == "Moving Speed" and value > self._model.speed_maximum:
            return Refusal.RANGE
        low, high = memory["CW Angle Limit"], memory["CCW Angle Limit"]
        if register.name == "Goal Position" and not low <= value <= high:
            return Refusal.RANGE if not 0 <= value < self._model.ticks else Refusal.LIMIT
        return None

    def stiffens(self, memory: RegisterMemory, names: Collection[str]) -> bool:
        """See `Controls`: users see it happen, the vendor says nothing."""
        return "Goal Position" in names or "Moving Speed" in names

    def written(self, memory: RegisterMemory, before: Mapping[str, int], drive: Drive) -> None:
        """See `Controls`."""

    def refresh(self, memory: RegisterMemory, drive: Drive, noise: float) -> None:
        """See `Controls`."""
        model, sign = self._model, self._direction(memory)
        ticks = self.ticks(memory, drive.shaft.angle) + noise
        speed = round(sign * drive.shaft.speed / model.speed_unit)
        load = round(sign * drive.output * model.load_maximum)
        memory["Present Position"] = self._in_range(memory, ticks)
        memory["Present Speed"] = encode_sign_magnitude(max(-_HIGHEST, min(_HIGHEST, speed)))
        memory["Present Load"] = encode_sign_magnitude(load)
        memory["Moving"] = int(drive.moving)
        if "Current" in memory:
            memory["Current"] = 2048 + round(sign * drive.current * _STALL)

    def shut_down(self, memory: RegisterMemory) -> bool:
        """See `Controls`: protocol 1.0 takes the torque limit away, XL-320 switches off."""
        name = "Torque Limit" if self._model.protocol == 1 else "Torque Enable"
        on = bool(memory[name])
        memory[name] = 0
        return on

    def _is_wheel(self, memory: RegisterMemory) -> bool:
        if "Control Mode" in memory:
            return memory["Control Mode"] == 1
        return memory["CW Angle Limit"] == memory["CCW Angle Limit"] == 0

    def _is_multi_turn(self, memory: RegisterMemory) -> bool:
        highest = self._model.ticks - 1
        return self._model.endless and (
            memory["CW Angle Limit"] == memory["CCW Angle Limit"] == highest
        )

    def _direction(self, memory: RegisterMemory) -> int:
        return -1 if memory.get("Drive Mode", 0) & 1 else 1

    def _in_range(self, memory: RegisterMemory, ticks: float) -> int:
        if self._is_multi_turn(memory):
            return max(-28_672, min(28_672, round(ticks)))
        if self._model.endless:
            return round(ticks) % self._model.ticks
        return max(0, min(self._model.ticks - 1, round(ticks)))

    def _angle(self, memory: RegisterMemory, ticks: int) -> float:
        offset = memory["Multi Turn Offset"] if self._is_multi_turn(memory) else 0
        turned = (ticks - offset - self._model.center) * self._model.radians_per_tick
        return self._direction(memory) * turned

    def _law(self, memory: RegisterMemory) -> ComplianceLaw:
        punch, limit = memory["Punch"] / 1023.0, memory["Torque Limit"] / 1023.0
        if "P Gain" in memory:
            gain = memory["P Gain"]
            slope = _GAIN_SLOPE / gain if gain else math.inf
            return ComplianceLaw.proportional(self._model, slope, limit, punch)
        unit = self._model.radians_per_tick

        def side(name: str) -> Side:
            slope = slope_ticks(memory[f"{name} Compliance Slope"])
            return Side(memory[f"{name} Compliance Margin"] * unit, slope * unit)

        return ComplianceLaw(side("CW"), side("CCW"), punch, limit, AX_DAMPING)
