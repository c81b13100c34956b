"""What a simulated servo finds wrong with itself, and what it does about it."""

from __future__ import annotations

from typing import Final

from head_tracking.dynamixel.models import ServoModel
from head_tracking.simulation.memory import RegisterMemory

OVERLOAD_TIME: Final = 1_000_000_000
"""Time for which a servo bears a load that it cannot move, ns (ours)."""


class Alarms:
    """The error bits of a servo.

    Protocol 1.0: voltage and temperature errors are there as long as their cause is. An overload
    that shuts the servo down stays until Torque Limit is written. Protocol 2.0: whatever shuts the
    servo down stays until it is rebooted.

    Args:
        model: The model.

    Attributes:
        active: The bits (`ServoModel.errors`) that every answer tells of.
        forced: Bits that somebody else wants to be there, such as ENCODER.
    """

    def __init__(self, model: ServoModel) -> None:
        errors = model.errors
        self._voltage = int(errors["INPUT_VOLTAGE"])
        self._heat = int(errors["OVERHEATING"])
        self._overload = int(errors["OVERLOAD"])
        self._lasting = self._overload if model.protocol == 1 else 0xFF
        self._latched = 0
        self.active = 0
        self.forced = 0

    def look(self, memory: RegisterMemory, volts: float, celsius: float, strain: int) -> int:
        """Return the bits that shut the servo down now.

        Args:
            memory: Its registers.
            volts: Supply.
            celsius: Temperature.
            strain: For how long it has not been able to move its load, ns.
        """
        errors = self.forced
        if not memory["Min Voltage Limit"] <= round(volts * 10.0) <= memory["Max Voltage Limit"]:
            errors |= self._voltage
        if celsius > memory["Temperature Limit"]:
            errors |= self._heat
        if strain > OVERLOAD_TIME:
            errors |= self._overload
        fatal = errors & memory["Shutdown"]
        self._latched |= fatal & self._lasting
        self.active = errors | self._latched
        return fatal | self._latched

    def clear(self) -> None:
        """Forget what has been and is no more."""
        self._latched = self.active = 0
