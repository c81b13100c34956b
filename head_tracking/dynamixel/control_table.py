"""Control tables: the registers of a servo, as data, and what their counts stand for.

Sources: the ROBOTIS e-manual page of each model; protocol 1.0 for the byte order, AX-12A for the
sign bits. Feetech's: the memory table of each family.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

from head_tracking.dynamixel.exceptions import RangeError, UnknownRegisterError

SIGN_BIT: Final = 10
"""AX, MX (protocol 1.0) and XL-320 mark clockwise speed and load by this bit."""


def encode_sign_magnitude(value: int, bit: int = SIGN_BIT) -> int:
    """Return a register value: magnitude in the low bits, sign bit set when negative (clockwise).

    Raises:
        RangeError: The magnitude needs more bits.
    """
    largest = (1 << bit) - 1
    if abs(value) > largest:
        raise RangeError(f"{value} does not fit; allowed are {-largest} to {largest}")
    return -value | 1 << bit if value < 0 else value


def decode_sign_magnitude(raw: int, bit: int = SIGN_BIT) -> int:
    """Return the signed number in a sign-magnitude register; inverse of the encoder.

    Raises:
        RangeError: A bit above the sign bit is set, or the value is negative.
    """
    if not 0 <= raw < 2 << bit:
        raise RangeError(
            f"register value {raw} is no {bit} bit sign-magnitude number; "
            f"allowed are 0 to {(2 << bit) - 1}"
        )
    return -(raw & (1 << bit) - 1) if raw >> bit else raw


class Sign(Enum):
    """How a register stores negative values: magnitude and a sign bit, or two's complement."""

    NONE = "none"
    BIT_10 = "bit 10"
    BIT_11 = "bit 11"
    BIT_15 = "bit 15"
    TWOS_COMPLEMENT = "two's complement"

    @property
    def bit(self) -> int:
        """The sign bit; 0 if there is none."""
        return int(self.value.removeprefix("bit ")) if self.value.startswith("bit ") else 0


@dataclass(frozen=True, slots=True)
class Unit:
    """What one count of a register stands for.

    Attributes:
        symbol: The unit; empty for plain numbers and codes.
        scale: One count in that unit.
        zero: The count that stands for 0.
    """

    symbol: str = ""
    scale: float = 1.0
    zero: float = 0.0


NUMBER = Unit()


@dataclass(frozen=True, slots=True)
class Register:
    """One register, in the vendor's words.

    Attributes:
        name: The vendor's name.
        address: First byte.
        size: Bytes.
        writable: Whether a packet may write it.
        eeprom: Whether its value survives power-off; if not, it is in RAM.
        initial: Factory value (EEPROM) or value at power-on (RAM); None where the vendor gives none
            or it is taken from elsewhere.
        minimum: Lowest value a write may carry; None for read-only registers.
        maximum: Highest value a write may carry; None for read-only registers.
        unit: What one count stands for.
        sign: How it stores negative values.
    """

    name: str
    address: int
    size: int
    writable: bool
    eeprom: bool
    initial: int | None = None
    minimum: int | None = None
    maximum: int | None = None
    unit: Unit = NUMBER
    sign: Sign = Sign.NONE

    @property
    def end(self) -> int:
        """Address of the first byte after the register."""
        return self.address + self.size

    def admits(self, value: int) -> bool:
        """Return whether a write may carry this value."""
        lowest, highest = self.minimum, self.maximum
        return lowest is not None and highest is not None and lowest <= value <= highest

    def in_unit(self, value: int) -> float:
        """Return a value that was read in the register's unit.

        Raises:
            RangeError: It is no sign-magnitude number, though the register should hold one.
        """
        return (self.counts(value) - self.unit.zero) * self.unit.scale

    def counts(self, value: int) -> int:
        """Return the number that a value that was read stands for; raises as `in_unit` does."""
        bit = self.sign.bit
        return decode_sign_magnitude(value, bit) if bit else value

    def from_unit(self, quantity: float) -> int:
        """Return the value to write for a quantity in the register's unit; mirrors `in_unit`."""
        counts = round(quantity / self.unit.scale + self.unit.zero)
        return self.from_counts(counts)

    def from_counts(self, counts: int) -> int:
        """Return the value to write for a number; mirrors `counts`.

        Raises:
            RangeError: A sign-magnitude register has too few bits for it.
        """
        bit = self.sign.bit
        return encode_sign_magnitude(counts, bit) if bit else counts


_STRUCT_CODES = {1: "B", 2: "H", 4: "I"}


@dataclass(frozen=True, slots=True)
class Block:
    """One register or several that one packet reads or writes.

    Values of sign-magnitude registers are not decoded: sign and magnitude stay together.

    Attributes:
        registers: In rising order of address; bytes between them are skipped.
        byte_order: "little" or "big".
        layout: Packs and unpacks one value per register, unchecked.
    """

    registers: tuple[Register, ...]
    byte_order: str = "little"
    layout: struct.Struct = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        form = {"little": "<", "big": ">"}[self.byte_order]
        position = self.address
        for register in self.registers:
            if register.address < position:
                raise RangeError(f"{register.name} must stand before its predecessor in the block")
            code = _STRUCT_CODES[register.size]
            if register.sign is Sign.TWOS_COMPLEMENT:
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

    def decode(self, data: bytes) -> tuple[int, ...]:
        """Return one value per register.

        Raises:
            RangeError: The number of bytes is wrong.
        """
        if len(data) != self.length:
            raise RangeError(f"the block has {self.length} bytes, not {len(data)}")
        return self.layout.unpack(data)

    def encode(self, *values: int) -> bytes:
        """Return the bytes that write one value per register.

        Raises:
            RangeError: A value is outside its register, or the block has gaps or another length.
        """
        if len(values) != len(self.registers):
            raise RangeError(f"the block has {len(self.registers)} values, not {len(values)}")
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
    """The registers of one servo model, found by name.

    Args:
        name: What the table belongs to, for messages.
        registers: All documented registers; addresses between them are reserved.
        byte_order: Of registers with several bytes, "little" or "big".

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
            raise UnknownRegisterError(
                f"{self.name} has no register {name!r}; it has: {', '.join(self._by_name)}"
            ) from None

    def __contains__(self, name: object) -> bool:
        return name in self._by_name

    def __iter__(self) -> Iterator[Register]:
        return iter(self._registers)

    def __len__(self) -> int:
        return len(self._registers)

    @property
    def size(self) -> int:
        """Number of bytes up to the end of the last register."""
        return self._registers[-1].end

    def block(self, *names: str) -> Block:
        """Return the block of these registers, named in rising order of address."""
        return Block(tuple(self[name] for name in names), self._byte_order)

    def spans(
        self, longest: int, names: Collection[str] | None = None, *, gaps: bool = True
    ) -> Iterator[Block]:
        """Yield blocks, of at most so many bytes, of the registers of these names that there are.

        Args:
            longest: Bytes of a block.
            names: In any order; None for all registers.
            gaps: Whether a block may have bytes between its registers.
        """
        span: list[Register] = []
        for register in self._registers:
            if names is not None and register.name not in names:
                continue
            apart = bool(span) and not gaps and register.address != span[-1].end
            if span and (apart or register.end - span[0].address > longest):
                yield Block(tuple(span), self._byte_order)
                span = []
            span.append(register)
        yield Block(tuple(span), self._byte_order)
