"""Servo models, read from the data files in `tables/`, one for each model.

Feetech's are in `head_tracking/feetech/tables/`. A file has the model's properties, its control
table and the units of its registers. With `like` it has only the differences from another file.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import IntFlag
from functools import cache
from operator import itemgetter
from pathlib import Path
from typing import Any, Final, NamedTuple

from head_tracking.compatibility import tomllib
from head_tracking.dynamixel.control_table import (
    NUMBER,
    Block,
    ControlTable,
    Register,
    Unit,
)
from head_tracking.dynamixel.exceptions import ConfigurationError, DynamixelError
from head_tracking.dynamixel.protocol import ErrorBits, HardwareErrors, XL320Errors
from head_tracking.feetech import BYTE_ORDERS, FeetechErrors
from head_tracking.feetech import TABLES as FEETECH_TABLES
from head_tracking.parameters import nearest

TABLES: Final = Path(__file__).parent / "tables"

_FOLDERS: Final = (TABLES, FEETECH_TABLES)
_RPM: Final = 2.0 * math.pi / 60.0  # rad/s
_COUNTS: Final = {
    "scale": 1.0,
    "degrees": math.radians(1.0),
    "rpm": _RPM,
    "rpm_per_minute": _RPM / 60.0,
}
"""Units in which a file may give one count of a register, in the register's unit."""
_ERROR_BITS: Final[Mapping[str, type[IntFlag]]] = {
    "status": ErrorBits, "hardware": HardwareErrors, "xl320": XL320Errors, "feetech": FeetechErrors
}  # fmt: skip
_FEEDBACK: Final = ("position", "speed", "load", "voltage", "temperature")


class RequiredMode(NamedTuple):
    """The value that a register must have for position control in the driver's units."""

    value: int  # its bits
    otherwise: str  # what is wrong with a servo that has other bits
    mask: int = 0xFF  # which bits

    def fits(self, value: int) -> bool:
        """Return whether a register value is right."""
        return value & self.mask == self.value


@dataclass(frozen=True, slots=True, kw_only=True)
class ServoModel:
    """Properties of a servo model."""

    name: str  # in configurations and messages
    model_number: int  # contents of its Model Number register
    protocol: int  # of Dynamixel, 1 or 2; Feetech servos use the packets of 1
    control_table: ControlTable
    feedback: Block  # registers that are read in each cycle
    # Picks position, speed, load, voltage and temperature from the values of `feedback`.
    measured: Callable[[tuple[int, ...]], tuple[int, ...]]
    goal: Block  # registers that one write sets: position, speed, and others that are 0
    # Puts position, speed and 0 in the order of `goal`.
    goal_values: Callable[[tuple[int, int, int]], tuple[int, ...]]
    goal_speed: str  # register of the goal speed
    position_limits: tuple[str, str]  # registers of the lowest and highest goal position
    ticks: int  # number of positions
    endless: bool  # whether the ticks go round a whole turn
    # Ticks between an end of the scale and the goals next to it: a servo that overshoots the end
    # reads the other end, and turns all round.
    goal_margin: int = 0
    center: int  # tick in the middle of the range
    radians_per_tick: float
    speed_unit: float  # one count, rad/s
    speed_maximum: int  # highest goal speed in joint mode, counts
    speed_minimum: int = 1  # lowest goal speed above 0, which would be full speed, counts
    load_maximum: int  # register value of full load (of stall current, where current is measured)
    no_load_speed: float  # at the nominal voltage, rad/s
    nominal_voltage: float  # recommended supply, V
    baud_rates: Mapping[int, int]  # bit/s by value of the Baud Rate register
    errors: type[IntFlag]  # bits of its error state and of its Shutdown register
    signs: tuple[int, int, int]  # sign bits of position, speed, load; 0: two's complement or none
    bulk_read: bool = False  # MX with protocol 1.0
    sync_read: bool = False  # protocol 2.0, Feetech STS
    family: str = "Dynamixel"  # "Dynamixel", "STS" or "SCS"; families cannot share a line
    modes: Mapping[str, RequiredMode]  # required values by register name
    offset: Register | None  # that is added to the position; None: there is none
    watchdog: int | None = None  # first firmware with a Bus Watchdog; None: none
    aliases: tuple[str, ...] = ()  # other names of the model

    @property
    def settings(self) -> set[str]:
        """Registers, where a model has them, that its joint needs as they are."""
        own = [] if self.offset is None else [self.offset.name]
        return {*self.modes, *self.position_limits, "Drive Mode", "Secondary ID", *own}

    @property
    def restarts(self) -> bool:
        """Whether a restart clears its errors; otherwise writing its Torque Limit does."""
        return "Hardware Error Status" in self.control_table

    def acknowledges_writes(self, level: int) -> bool:
        """Return whether it replies to writes with this Status Return Level."""
        return level == self.control_table["Status Return Level"].maximum


@cache
def servo_model(name: str) -> ServoModel:
    """Return the model of that name or alias, in upper or lower case.

    Raises:
        ConfigurationError: No such model is known.
    """
    for usual in (folder / _file_name(name) for folder in _FOLDERS):
        if usual.is_file() and (model := read_model(usual)).name.upper() == name.upper():
            return model
    for model in all_models():
        if name.upper() in map(str.upper, (model.name, *model.aliases)):
            return model
    hint = nearest(name.upper(), (model.name for model in all_models()))
    raise ConfigurationError(f"unknown servo model {name!r}{hint}; known are {_known()}")


def servo_model_by_number(model_number: int) -> ServoModel:
    """Return the model with that Model Number; raise ConfigurationError if there is none."""
    for model in all_models():
        if model.model_number == model_number:
            return model
    raise ConfigurationError(f"unknown servo model number {model_number}; known are {_known()}")


@cache
def all_models() -> tuple[ServoModel, ...]:
    """Return all models, by model number and name."""
    models = [read_model(path) for folder in _FOLDERS for path in folder.glob("*.toml")]
    return tuple(sorted(models, key=lambda model: (model.model_number, model.name)))


def _file_name(model_name: str) -> str:
    return re.sub(r"\W+", "_", model_name.lower().replace("(2.0)", "_2")) + ".toml"


def _known() -> str:
    return ", ".join(f"{model.name} ({model.model_number})" for model in all_models())


@cache
def read_model(path: Path) -> ServoModel:
    """Return the model that a data file describes; raise ConfigurationError if it is wrong."""
    try:
        return _model(_document(path))
    except (DynamixelError, OSError, KeyError, TypeError, ValueError) as cause:
        raise ConfigurationError(f"{path} describes no servo model: {cause!r}") from cause


@cache
def _document(path: Path) -> dict[str, Any]:
    """Return the contents of a data file, completed by the file that it is like."""
    own = tomllib.loads(path.read_text(encoding="utf-8"))
    if "like" not in own:
        return own
    base = _document(path.with_name(_file_name(own.pop("like"))))
    absent = own.pop("absent", ())
    registers = {name: row for name, row in base["registers"].items() if name not in absent}
    for name, row in own.get("registers", {}).items():
        registers[name] = registers.get(name, {}) | row
    for key in ("feedback", "goal", "units"):
        own[key] = base[key] | own.get(key, {})
    return {**base, "aliases": (), **own, "registers": registers}


def _model(document: Mapping[str, Any]) -> ServoModel:
    facts = dict(document)  # what is left of it are attributes of the model
    if "model_number" in facts:
        raise ValueError('give model_number as the initial value of "Model Number" in [registers]')
    units = {key: _unit(**row) for key, row in facts.pop("units").items()}
    rows = facts.pop("registers").items()
    table = ControlTable(
        facts["name"],
        tuple(each for key, row in rows for each in _registers(key, row, units)),
        BYTE_ORDERS.get(facts.get("family", ""), "little"),
    )
    number = table["Model Number"].initial
    if number is None:
        raise ValueError("Model Number has no initial value")
    feedback, goal = facts.pop("feedback"), facts.pop("goal")
    wanted = [feedback[key] for key in _FEEDBACK]
    read = sorted(wanted, key=lambda name: table[name].address)
    written = table.block(*sorted(goal.values(), key=lambda name: table[name].address))
    places = {goal["position"]: 0, goal["speed"]: 1}
    lowest, highest = facts.pop("position_limits")
    bits = [table[name].sign_bit for name in wanted[:3]]
    position_sign, speed_sign, load_sign = (1 << bit if bit else 0 for bit in bits)
    modes = {n: RequiredMode(**row) for n, row in facts.pop("modes", {}).items() if n in table}
    offset = facts.pop("offset", None)
    return ServoModel(
        model_number=number,
        control_table=table,
        feedback=table.block(*read),
        measured=itemgetter(*map(read.index, wanted)),
        goal=written,
        goal_values=itemgetter(*[places.get(each.name, 2) for each in written.registers]),
        goal_speed=goal["speed"],
        position_limits=(lowest, highest),
        center=int(units["position"].zero),
        radians_per_tick=units["position"].scale,
        speed_unit=units["speed"].scale,
        no_load_speed=facts.pop("no_load_rpm") * _RPM,
        baud_rates={int(code): rate for code, rate in facts.pop("baud_rates").items()},
        errors=_ERROR_BITS[facts.pop("error_bits")],
        signs=(position_sign, speed_sign, load_sign),
        modes=modes,
        offset=None if offset is None else table[offset],
        watchdog=facts.pop("watchdog", None) or None,
        aliases=tuple(facts.pop("aliases", ())),
        **facts,
    )


def _unit(symbol: str, zero: float = 0.0, **count: float) -> Unit:
    ((kind, value),) = count.items() or {"scale": 1.0}.items()
    return Unit(symbol, value * _COUNTS[kind], zero)


def _registers(name: str, row: Mapping[str, Any], units: Mapping[str, Unit]) -> Iterator[Register]:
    """Yield the register of a row, or those of a numbered row, such as "Indirect Data 1-28"."""
    facts = dict(row)  # what is left of it are attributes of the register
    address, initial = facts.pop("address"), facts.pop("initial", None)
    step = facts.pop("initial_step", 0)
    facts["writable"] = {"R": False, "RW": True}[facts.pop("access")]
    facts["eeprom"] = {"EEPROM": True, "RAM": False}[facts.pop("memory")]
    facts["minimum"], facts["maximum"] = facts.pop("range", (None, None))
    facts["unit"] = units[facts["unit"]] if "unit" in facts else NUMBER
    numbers = re.fullmatch(r"(.* )(\d+)-(\d+)", name)
    names = [name]
    if numbers:
        names = [f"{numbers[1]}{n}" for n in range(int(numbers[2]), int(numbers[3]) + 1)]
    for index, each in enumerate(names):
        first = None if initial is None else initial + index * step
        yield Register(each, address + index * facts["size"], initial=first, **facts)
