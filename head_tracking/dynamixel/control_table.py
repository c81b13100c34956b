"""Control tables: the registers of a servo, as data."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum

from head_tracking.dynamixel.conversions import decode_unsigned, encode_unsigned
from head_tracking.dynamixel.exceptions import RangeError, UnknownRegisterError


class Access(Enum):
    """What a packet may do with a register."""

    READ = "R"
    READ_WRITE = "RW"


class Memory(Enum):
    """Where a register lives: EEPROM survives power-off, RAM does not."""

    EEPROM = "EEPROM"
    RAM = "RAM"


@dataclass(frozen=True, slots=True)
class Register:
    """One register, in the vendor's words.

    Attributes:
        name: The vendor's name.
        address: First byte.
        size: Bytes, low byte first.
        access: Whether it can be written.
        memory: EEPROM or RAM.
        initial: Factory value (EEPROM) or value at power-on (RAM); None where the vendor gives none
            or it is taken from elsewhere.
        minimum: Lowest value a write may carry; None for read-only registers.
        maximum: Highest value a write may carry; None for read-only registers.
    """

    name: str
    address: int
    size: int
    access: Access
    memory: Memory
    initial: int | None = None
    minimum: int | None = None
    maximum: int | None = None

    @property
    def end(self) -> int:
        """Address of the first byte after the register."""
        return self.address + self.size

    @property
    def writable(self) -> bool:
        """Whether a packet may write it."""
        return self.access is Access.READ_WRITE

    def admits(self, value: int) -> bool:
        """Return whether a write may carry this value."""
        if not self.writable or self.minimum is None or self.maximum is None:
            return False
        return self.minimum <= value <= self.maximum

    def encode(self, value: int) -> bytes:
        """Return the bytes that write `value`.

        Raises:
            RangeError: The register is read-only or the value is outside its range.
        """
        if not self.admits(value):
            allowed = f"{self.minimum} to {self.maximum}" if self.writable else "none, read only"
            raise RangeError(f"{self.name} cannot be {value}; allowed: {allowed}")
        return encode_unsigned(value, self.size)

    def decode(self, data: bytes) -> int:
        """Return the value in exactly this register's bytes.

        Raises:
            RangeError: The number of bytes is wrong.
        """
        if len(data) != self.size:
            raise RangeError(f"{self.name} has {self.size} byte(s), not {len(data)}")
        return decode_unsigned(data)


_STRUCT_CODES = {1: "B", 2: "H", 4: "I"}


@dataclass(frozen=True, slots=True)
class Block:
    """Several registers that one packet reads or writes.

    Attributes:
        registers: In rising order of address; bytes between them are skipped.
    """

    registers: tuple[Register, ...]
    _struct: struct.Struct = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        form = "<"
        position = self.registers[0].address
        for register in self.registers:
            if register.address < position:
                raise RangeError(f"{register.name} must stand before its predecessor in the block")
            form += f"{register.address - position}x{_STRUCT_CODES[register.size]}"
            position = register.end
        object.__setattr__(self, "_struct", struct.Struct(form))

    @property
    def address(self) -> int:
        """Address of the first byte."""
        return self.registers[0].address

    @property
    def length(self) -> int:
        """Number of bytes from the first register to the end of the last."""
        return self._struct.size

    def decode(self, data: bytes) -> tuple[int, ...]:
        """Return one value per register.

        Raises:
            RangeError: The number of bytes is wrong.
        """
        if len(data) != self._struct.size:
            raise RangeError(f"the block has {self._struct.size} bytes, not {len(data)}")
        return self._struct.unpack(data)

    def encode(self, *values: int) -> bytes:
        """Return the bytes that write one value per register.

        Raises:
            RangeError: A value is outside its register, or the block has gaps or another length.
        """
        if len(values) != len(self.registers):
            raise RangeError(f"the block has {len(self.registers)} values, not {len(values)}")
        data = b"".join(
            register.encode(value) for register, value in zip(self.registers, values, strict=True)
        )
        if len(data) != self._struct.size:
            raise RangeError("the block has gaps, so it can be read but not written")
        return data


class ControlTable:
    """The registers of one servo model, found by name.

    Args:
        name: What the table belongs to, for messages.
        registers: All documented registers; addresses between them are reserved.

    Raises:
        RangeError: Two registers overlap or share a name.
    """

    def __init__(self, name: str, registers: tuple[Register, ...]) -> None:
        self.name = name
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
        return Block(tuple(self[name] for name in names))


_R, _RW = Access.READ, Access.READ_WRITE
_EEPROM, _RAM = Memory.EEPROM, Memory.RAM

AX_12 = ControlTable(
    "AX-12",
    (
        Register("Model Number", 0, 2, _R, _EEPROM, 12),
        Register("Firmware Version", 2, 1, _R, _EEPROM),
        Register("ID", 3, 1, _RW, _EEPROM, 1, 0, 253),
        Register("Baud Rate", 4, 1, _RW, _EEPROM, 1, 0, 254),
        Register("Return Delay Time", 5, 1, _RW, _EEPROM, 250, 0, 254),
        Register("CW Angle Limit", 6, 2, _RW, _EEPROM, 0, 0, 1023),
        Register("CCW Angle Limit", 8, 2, _RW, _EEPROM, 1023, 0, 1023),
        Register("Temperature Limit", 11, 1, _RW, _EEPROM, 70, 0, 99),
        Register("Min Voltage Limit", 12, 1, _RW, _EEPROM, 60, 50, 250),
        Register("Max Voltage Limit", 13, 1, _RW, _EEPROM, 140, 50, 250),
        Register("Max Torque", 14, 2, _RW, _EEPROM, 1023, 0, 1023),
        Register("Status Return Level", 16, 1, _RW, _EEPROM, 2, 0, 2),
        Register("Alarm LED", 17, 1, _RW, _EEPROM, 36, 0, 127),
        Register("Shutdown", 18, 1, _RW, _EEPROM, 36, 0, 127),
        Register("Torque Enable", 24, 1, _RW, _RAM, 0, 0, 1),
        Register("LED", 25, 1, _RW, _RAM, 0, 0, 1),
        Register("CW Compliance Margin", 26, 1, _RW, _RAM, 1, 0, 255),
        Register("CCW Compliance Margin", 27, 1, _RW, _RAM, 1, 0, 255),
        Register("CW Compliance Slope", 28, 1, _RW, _RAM, 32, 1, 254),
        Register("CCW Compliance Slope", 29, 1, _RW, _RAM, 32, 1, 254),
        Register("Goal Position", 30, 2, _RW, _RAM, None, 0, 1023),
        Register("Moving Speed", 32, 2, _RW, _RAM, 0, 0, 2047),
        Register("Torque Limit", 34, 2, _RW, _RAM, None, 0, 1023),
        Register("Present Position", 36, 2, _R, _RAM),
        Register("Present Speed", 38, 2, _R, _RAM),
        Register("Present Load", 40, 2, _R, _RAM),
        Register("Present Voltage", 42, 1, _R, _RAM),
        Register("Present Temperature", 43, 1, _R, _RAM),
        Register("Registered", 44, 1, _R, _RAM, 0),
        Register("Moving", 46, 1, _R, _RAM, 0),
        Register("Lock", 47, 1, _RW, _RAM, 0, 0, 1),
        Register("Punch", 48, 2, _RW, _RAM, 32, 32, 1023),
    ),
)
"""AX-12, AX-12+ and AX-12A: ROBOTIS e-manual page AX-12A; ranges also from the manual of 2006.

Moving Speed goes to 1023 in joint mode and to 2047 in wheel mode.
"""
