"""Properties and registers of each servo model, read from `facts/`.

The driver has its own tables, so that a wrong address in one of them is detected. Sources: ROBOTIS
e-manual page of each model; ftservo-wiki 9522ce1, memory tables of STS and SCS.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final, Literal, Protocol

from head_tracking.exceptions import HeadTrackingError

RPM: Final = 2.0 * math.pi / 60.0
"""One revolution per minute, rad/s."""

ByteOrder = Literal["little", "big"]

_FACTS: Final = Path(__file__).parent / "facts"


class SimulationError(HeadTrackingError):
    """The simulator was set up or used in a wrong way. Bytes from the wire never raise it."""


class Named(Protocol):
    """An object with the name of a model, such as the driver's `ServoModel`."""

    @property
    def name(self) -> str:
        """Name of the model."""


@dataclass(frozen=True, slots=True)
class Register:
    """One register."""

    name: str  # the vendor's name
    address: int  # address of the first byte
    size: int  # number of bytes
    writable: bool  # whether a packet may write it
    eeprom: bool  # whether it keeps its value without power
    signed: bool  # whether it holds two's complement
    # Factory value, or value at power-on; None if the vendor does not state one
    initial: int | None
    lowest: int  # lowest value that a packet may write
    highest: int  # highest value that a packet may write
    order: ByteOrder = "little"

    @property
    def end(self) -> int:
        """Address of the first byte after it."""
        return self.address + self.size

    def decode(self, data: bytes) -> int:
        """Return the value of the register's bytes; a sign bit stays part of the value."""
        return int.from_bytes(data, self.order, signed=self.signed)


@dataclass(frozen=True, slots=True)
class SimulatedModel:
    """A servo model."""

    name: str  # the vendor's name
    number: int  # contents of its Model Number register
    protocol: int  # 1 or 2; Feetech servos use the packets of 1
    # Control law: "compliance" (margin and slope), "gain", "profile", or the Feetech families
    # "sts" and "scs"
    control: str
    ticks: int  # number of positions
    endless: bool  # whether the positions cover a whole turn
    center: int  # the tick in the middle
    radians_per_tick: float
    speed_unit: float  # one count of speed, rad/s
    speed_maximum: int  # highest goal speed in joint mode, in counts
    load_maximum: int  # register value of full load, or of the stall current
    no_load_speed: float  # rad/s, at `nominal_voltage`
    stall_torque: float  # N m, at `nominal_voltage`
    nominal_voltage: float  # V
    voltage_error: int  # bit of the error state
    heat_error: int  # bit of the error state
    overload_error: int  # bit of the error state
    baud_rates: Mapping[int, int]  # bits per second by the value of the Baud Rate register
    registers: str  # the model, in registers.csv, that has the same registers

    @property
    def is_feetech(self) -> bool:
        """Whether Feetech makes it."""
        return self.control in ("sts", "scs")


def _rows(name: str) -> list[dict[str, str]]:
    with (_FACTS / name).open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))


@cache
def _models() -> dict[str, SimulatedModel]:
    return {row["name"].upper(): _model(row) for row in _rows("models.csv")}


def _model(row: Mapping[str, str]) -> SimulatedModel:
    ticks = int(row["ticks"])
    rates = (code.split("=") for code in row["baud_rates"].split())
    return SimulatedModel(
        name=row["name"],
        number=int(row["number"]),
        protocol=int(row["protocol"]),
        control=row["control"],
        ticks=ticks,
        endless=row["endless"] == "yes",
        center=ticks // 2,
        radians_per_tick=math.radians(float(row["degrees"])) / ticks,
        speed_unit=float(row["rpm_per_count"]) * RPM,
        speed_maximum=int(row["top_speed"]),
        load_maximum=int(row["full_load"]),
        no_load_speed=float(row["no_load_rpm"]) * RPM,
        stall_torque=float(row["stall_torque"]),
        nominal_voltage=float(row["volts"]),
        voltage_error=1 << int(row["voltage_bit"]),
        heat_error=1 << int(row["heat_bit"]),
        overload_error=1 << int(row["overload_bit"]),
        baud_rates={int(code): int(rate) for code, rate in rates},
        registers=row["registers"] or row["name"],
    )


def simulated_model(model: str | Named) -> SimulatedModel:
    """Return a model by its name.

    Raises:
        SimulationError: The model is unknown.
    """
    name = model if isinstance(model, str) else model.name
    try:
        return _models()[name.upper()]
    except KeyError:
        known = ", ".join(each.name for each in _models().values())
        raise SimulationError(
            f"the servo model {name!r} cannot be simulated; known models: {known}"
        ) from None


@cache
def registers_of(name: str, firmware: int) -> tuple[Register, ...]:
    """Return the registers of a model and firmware version, ordered by address.

    Raises:
        SimulationError: there are none.
    """
    found: list[Register] = []
    model = simulated_model(name)
    for row in _rows("registers.csv"):
        since, until = int(row["since"] or 0), int(row["until"] or 255)
        if model.registers not in row["models"].split() or not since <= firmware <= until:
            continue
        initial = int(row["initial"]) if row["initial"] else None
        if row["register"] == "Model Number":
            initial = model.number
        base, size, count = row["register"], int(row["size"]), int(row["count"])
        for index in range(count):
            register = base
            if count > 1:
                stem, first = base.rsplit(" ", 1)
                register = f"{stem} {int(first) + index}"
            grows = index if base.startswith("Indirect Address") else 0
            found.append(
                Register(
                    register,
                    int(row["address"]) + index * size,
                    size,
                    row["access"] == "RW",
                    row["memory"] == "EEPROM",
                    row["sign"] == "signed",
                    None if initial is None else initial + grows,
                    int(row["lowest"] or 0),
                    int(row["highest"] or 0),
                    "big" if model.control == "scs" else "little",
                )
            )
    if not found:
        raise SimulationError(f"registers.csv has no rows of {model.registers}")
    return tuple(sorted(found, key=lambda register: register.address))


def to_sign_magnitude(value: int, bit: int) -> int:
    """Return a number with its sign in a bit; the magnitude is limited to the bits below."""
    magnitude = min(abs(value), (1 << bit) - 1)
    return magnitude | 1 << bit if value < 0 else magnitude


def from_sign_magnitude(raw: int, bit: int) -> int:
    """Return the number whose sign is in a bit."""
    magnitude = raw & (1 << bit) - 1
    return -magnitude if raw >> bit & 1 else magnitude
