"""Control tables: the registers of a servo as data, and their units.

Sources: the ROBOTIS e-manual page of each model; the memory table of each Feetech family.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field

from head_tracking.dynamixel.exceptions import RangeError


@dataclass(frozen=True, slots=True)
class Unit:
    """Unit of a register."""

    symbol: str = ""  # the unit; empty for plain numbers and codes
    scale: float = 1.0  # one count in that unit
    zero: float = 0.0  # the count of 0


NUMBER = Unit()


@dataclass(frozen=True, slots=True)
class Register:
    """One register."""

    name: str  # the vendor's name
    address: int  # of the first byte
    size: int  # bytes
    writable: bool  # whether a packet may write it
    eeprom: bool  # whether its value survives power-off
    # Factory value (EEPROM) or value at power-on (RAM); None: not documented.
    initial: int | None = None
    minimum: int | None = None  # lowest value of a write; None for read-only registers
    maximum: int | None = None  # highest value of a write; None for read-only registers
    unit: Unit = NUMBER
    sign_bit: int = 0  # of a number with magnitude and sign; 0: none
    signed: bool = False  # whether it holds two's complement

    @property
    def end(self) -> int:
        """Address of the first byte after the register."""
        return self.address + self.size

    def admits(self, value: int) -> bool:
        """Return whether this value may be written."""
        lowest, highest = self.minimum, self.maximum
        return lowest is not None and highest is not None and lowest <= value <= highest

    def counts(self, value: int) -> int:
        """Return the signed number of a register value.

        Raises:
            RangeError: It is no sign-magnitude number, though the register should hold one.
        """
        bit = self.sign_bit
        if bit and not 0 <= value < 2 << bit:
            raise RangeError(f"{self.name} cannot be {value}; allowed are 0 to {(2 << bit) - 1}")
        return (1 << bit) - value if bit and value >> bit else value

    def in_unit(self, value: int) -> float:
        """Return a register value in the register's unit; raises as `counts` does."""
        return (self.counts(value) - self.unit.zero) * self.unit.scale

    def from_counts(self, counts: int) -> int:
        """Return the register value of a signed number; RangeError if it does not fit."""
        bit = self.sign_bit
        largest = (1 << bit) - 1
        if bit and abs(counts) > largest:
            raise RangeError(f"{counts} does not fit; allowed are {-largest} to {largest}")
        return -counts | 1 << bit if bit and counts < 0 else counts

    def from_unit(self, quantity: float) -> int:
        """Return the register value of a quantity in the register's unit."""
        return self.from_counts(round(quantity / self.unit.scale + self.unit.zero))


_STRUCT_CODES = {1: "B", 2: "H", 4: "I"}


@dataclass(frozen=True, slots=True)
class Block:
    """Registers that one packet reads or writes; sign-magnitude values are not decoded."""

    registers: tuple[Register, ...]  # in rising order of address; bytes between them are skipped
    byte_order: str = "little"
    # Packs and unpacks one value for each register, unchecked
    layout: struct.Struct = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        form = {"little": "<", "big": ">"}[self.byte_order]
        position = self.address
        for register in self.registers:
            code = _STRUCT_CODES[register.size]
            if register.signed:
                code = code.lower()
            form += f"{register.address - position}x{code}"
            position = register.end
        object.__setattr__(self, "layout", struct.Struct(form))

    @property
    def address(self) -> int:
        """Address of the first byte."""
        return self.registers[0].address

    @property
    def length(self) -> int:
        """Number of bytes from the first register to the end of the last."""
        return self.layout.size

    def encode(self, *values: int) -> bytes:
        """Return the bytes that write one value into each register.

        Raises:
            RangeError: A value is out of range, or the block has gaps.
        """
        for register, value in zip(self.registers, values, strict=True):
            if not register.admits(value):
                allowed = f"{register.minimum} to {register.maximum}"
                if not register.writable:
                    allowed = "none, read only"
                raise RangeError(f"{register.name} cannot be {value}; allowed: {allowed}")
        if sum(register.size for register in self.registers) != self.length:
            raise RangeError("the block has gaps, so it can be read but not written")
        return self.layout.pack(*values)


class ControlTable:
    """The registers of one servo model, by name.

    Args:
        name: Name of the model, for messages.
        registers: All documented registers.

    Raises:
        RangeError: Two registers overlap or share a name.
    """

    def __init__(
        self, name: str, registers: tuple[Register, ...], byte_order: str = "little"
    ) -> None:
        self.name = name
        self._byte_order = byte_order
        self._registers = tuple(sorted(registers, key=lambda register: register.address))
        self._by_name = {register.name: register for register in self._registers}
        if len(self._by_name) != len(self._registers):
            raise RangeError(f"control table {name} names a register twice")
        for lower, upper in zip(self._registers, self._registers[1:], strict=False):
            if lower.end > upper.address:
                raise RangeError(f"control table {name}: {lower.name} overlaps {upper.name}")

    def __getitem__(self, name: str) -> Register:
        try:
            return self._by_name[name]
        except KeyError:
            raise RangeError(
                f"{self.name} has no register {name!r}; it has: {', '.join(self._by_name)}"
            ) from None

    def __contains__(self, name: object) -> bool:
        return name in self._by_name

    def __iter__(self) -> Iterator[Register]:
        return iter(self._registers)

    def block(self, *names: str) -> Block:
        """Return the block of these registers, named in rising order of address."""
        return Block(tuple(self[name] for name in names), self._byte_order)

    def spans(self, longest: int, names: Collection[str] | None = None) -> Iterator[Block]:
        """Yield blocks of the registers with these names.

        Args:
            longest: Highest number of bytes of a block.
            names: In any order, also of registers that do not exist; None: all.
        """
        span: list[Register] = []
        for register in self._registers:
            if names is not None and register.name not in names:
                continue
            if span and register.end - span[0].address > longest:
                yield Block(tuple(span), self._byte_order)
                span = []
            span.append(register)
        yield Block(tuple(span), self._byte_order)
