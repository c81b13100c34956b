"""Servo models, read from the data files in `tables/`: one file for each model.

A file holds the model's properties, its control table and the units of its registers. With `like`
it states only what differs from another model's file. A new model is one file.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import IntFlag
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from head_tracking.dynamixel.control_table import (
    Access,
    Block,
    ControlTable,
    Memory,
    Register,
    Sign,
    Unit,
)
from head_tracking.dynamixel.exceptions import ConfigurationError, DynamixelError
from head_tracking.dynamixel.protocol import ErrorBits, HardwareErrors, XL320Errors

TABLES: Final = Path(__file__).parent / "tables"
"""Where the data files are."""

_RPM: Final = 2.0 * math.pi / 60.0  # rad/s
_COUNTS: Final = {
    "scale": 1.0,
    "degrees": math.radians(1.0),
    "rpm": _RPM,
    "rpm_per_minute": _RPM / 60.0,
}
"""What a unit's count may be given in, and that in the unit's symbol."""

_ERROR_BITS: Final[Mapping[str, type[IntFlag]]] = {
    "status": ErrorBits, "hardware": HardwareErrors, "xl320": XL320Errors
}  # fmt: skip
_FEEDBACK: Final = ("position", "speed", "load", "voltage", "temperature")
_FACTS: Final = frozenset(
    ("name", "aliases", "protocol", "ticks", "endless", "speed_maximum", "load_maximum",
     "no_load_rpm", "nominal_voltage", "error_bits", "bulk_read",
     "position_limits", "fast_sync_read", "watchdog", "feedback", "goal", "baud_rates", "units",
     "registers")
)  # fmt: skip
_ROW: Final = frozenset(
    ("address", "size", "access", "memory", "initial", "initial_step", "range", "unit", "sign")
)
_OWN: Final = ("name", "aliases")  # is never taken over from another model


@dataclass(frozen=True, slots=True)
class ServoModel:
    """What the driver must know about a model.

    Its speed without load is that of the e-manual page, at the voltage in bold there.

    Attributes:
        name: The name used in configurations and messages.
        model_number: Contents of its Model Number register.
        protocol: Dynamixel protocol, 1 or 2.
        control_table: Its registers.
        feedback: What one read fetches each cycle: position, speed, load, voltage, temperature.
        feedback_order: Where in that block the five of them stand.
        goal: What one write sets: goal position and speed.
        position_first: Whether the goal position comes first in that block.
        position_limits: Names of the registers with the lowest and highest goal position.
        ticks: Number of positions.
        endless: Whether the ticks go round a whole turn, so that each stands for many positions.
        center: The tick in the middle of the range.
        radians_per_tick: Angle of one tick, rad.
        speed_unit: One count of speed, rad/s.
        speed_maximum: Highest goal speed in joint mode.
        load_maximum: Register value of full load (of the stall current, where current is measured).
        no_load_speed: Fastest speed without load at `nominal_voltage`, rad/s.
        nominal_voltage: Supply that it is made for, V.
        baud_rates: Bits per second by the value of the Baud Rate register.
        errors: Bits of its error state and of its Shutdown register.
        sign_magnitude: Whether speed and load have their sign in bit 10.
        bulk_read: Whether it takes part in a bulk read (MX with protocol 1.0).
        fast_sync_read: First firmware that knows fast sync read; None: none does.
        watchdog: First firmware that has a Bus Watchdog; None: none has.
        aliases: Other names of the same model.
    """

    name: str
    model_number: int
    protocol: int
    control_table: ControlTable
    feedback: Block
    feedback_order: tuple[int, int, int, int, int]
    goal: Block
    position_first: bool
    position_limits: tuple[str, str]
    ticks: int
    endless: bool
    center: int
    radians_per_tick: float
    speed_unit: float
    speed_maximum: int
    load_maximum: int
    no_load_speed: float
    nominal_voltage: float
    baud_rates: Mapping[int, int]
    errors: type[IntFlag]
    sign_magnitude: bool
    bulk_read: bool
    fast_sync_read: int | None
    watchdog: int | None
    aliases: tuple[str, ...]


@cache
def servo_model(name: str) -> ServoModel:
    """Return the model of that name or alias, in capitals or not.

    Raises:
        ConfigurationError: No such model is known.
    """
    usual = TABLES / _file_name(name)
    if usual.is_file() and (model := read_model(usual)).name.upper() == name.upper():
        return model
    for model in all_models():
        if name.upper() in map(str.upper, (model.name, *model.aliases)):
            return model
    raise ConfigurationError(f"unknown servo model {name!r}; known are {_known()}")


def servo_model_by_number(model_number: int) -> ServoModel:
    """Return the model whose Model Number register holds `model_number`.

    Raises:
        ConfigurationError: No such model is known.
    """
    for model in all_models():
        if model.model_number == model_number:
            return model
    raise ConfigurationError(f"unknown servo model number {model_number}; known are {_known()}")


@cache
def all_models() -> tuple[ServoModel, ...]:
    """Return all models that there is a data file of, by model number."""
    models = map(read_model, TABLES.glob("*.toml"))
    return tuple(sorted(models, key=lambda model: model.model_number))


def _file_name(model_name: str) -> str:
    return re.sub(r"\W+", "_", model_name.lower().replace("(2.0)", "_2")) + ".toml"


def _known() -> str:
    return ", ".join(f"{model.name} ({model.model_number})" for model in all_models())


@cache
def read_model(path: Path) -> ServoModel:
    """Return the model that a data file describes.

    Raises:
        ConfigurationError: The file lacks something, or contradicts itself.
    """
    try:
        return _model(_document(path))
    except (DynamixelError, OSError, KeyError, TypeError, ValueError) as cause:
        raise ConfigurationError(f"{path} describes no servo model: {cause!r}") from cause


@cache
def _document(path: Path) -> dict[str, Any]:
    """Return the contents of a data file, completed by those of the one that it is like."""
    own = tomllib.loads(path.read_text(encoding="utf-8"))
    if "like" not in own:
        return own
    base = _document(path.with_name(_file_name(own.pop("like"))))
    inherited = {key: value for key, value in base.items() if key not in _OWN}
    absent = own.pop("absent", ())
    registers = {name: row for name, row in base["registers"].items() if name not in absent}
    for name, row in own.pop("registers", {}).items():
        registers[name] = registers.get(name, {}) | row
    baud_rates = own.pop("baud_rates", base["baud_rates"])
    for key in ("feedback", "goal", "units"):
        own[key] = base[key] | own.get(key, {})
    return {**inherited, **own, "registers": registers, "baud_rates": baud_rates}


def _model(facts: Mapping[str, Any]) -> ServoModel:
    _check_keys(facts, _FACTS)
    name, units = facts["name"], {key: _unit(**row) for key, row in facts["units"].items()}
    rows = facts["registers"].items()
    registers = [register for key, row in rows for register in _registers(key, row, units)]
    table = ControlTable(name, tuple(registers))
    number = table["Model Number"].initial
    if number is None:
        raise ValueError("Model Number has no initial value")
    feedback = [facts["feedback"][key] for key in _FEEDBACK]
    block = sorted(feedback, key=lambda register: table[register].address)
    goal = sorted(facts["goal"].values(), key=lambda register: table[register].address)
    a, b, c, d, e = map(block.index, feedback)
    lowest, highest = facts["position_limits"]
    return ServoModel(
        name=name,
        model_number=number,
        protocol=facts["protocol"],
        control_table=table,
        feedback=table.block(*block),
        feedback_order=(a, b, c, d, e),
        goal=table.block(*goal),
        position_first=goal[0] == facts["goal"]["position"],
        position_limits=(lowest, highest),
        ticks=facts["ticks"],
        endless=facts["endless"],
        center=int(units["position"].zero),
        radians_per_tick=units["position"].scale,
        speed_unit=units["speed"].scale,
        speed_maximum=facts["speed_maximum"],
        load_maximum=facts["load_maximum"],
        no_load_speed=facts["no_load_rpm"] * _RPM,
        nominal_voltage=facts["nominal_voltage"],
        baud_rates=MappingProxyType({int(k): v for k, v in facts["baud_rates"].items()}),
        errors=_ERROR_BITS[facts["error_bits"]],
        sign_magnitude=table[facts["feedback"]["speed"]].sign is Sign.MAGNITUDE,
        bulk_read=facts["bulk_read"],
        fast_sync_read=facts.get("fast_sync_read") or None,
        watchdog=facts.get("watchdog") or None,
        aliases=tuple(facts.get("aliases", ())),
    )


def _check_keys(row: Mapping[str, Any], allowed: frozenset[str]) -> None:
    if unknown := row.keys() - allowed:
        raise ValueError(f"unknown {sorted(unknown)}; allowed are {sorted(allowed)}")


def _unit(symbol: str, zero: float = 0.0, **count: float) -> Unit:
    ((kind, value),) = count.items() or {"scale": 1.0}.items()
    return Unit(symbol, value * _COUNTS[kind], zero)


def _registers(name: str, row: Mapping[str, Any], units: Mapping[str, Unit]) -> Iterator[Register]:
    """Yield the register of a row, or those of a numbered row, such as "Indirect Data 1-28"."""
    _check_keys(row, _ROW)
    numbers = re.fullmatch(r"(.* )(\d+)-(\d+)", name)
    names = [name]
    if numbers:
        names = [f"{numbers[1]}{n}" for n in range(int(numbers[2]), int(numbers[3]) + 1)]
    lowest, highest = row.get("range", (None, None))
    for index, each in enumerate(names):
        initial = row.get("initial")
        if initial is not None:
            initial += index * row.get("initial_step", 0)
        yield Register(
            each,
            row["address"] + index * row["size"],
            row["size"],
            Access(row["access"]),
            Memory(row["memory"]),
            initial,
            lowest,
            highest,
            units[row["unit"]] if "unit" in row else Unit(),
            Sign(row.get("sign", "none")),
        )
