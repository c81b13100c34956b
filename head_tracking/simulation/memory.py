"""The memory of a simulated servo: its control table as bytes."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from typing import NamedTuple, overload

from head_tracking.dynamixel.control_table import ControlTable, Memory, Register, Sign

_ADDRESS, _DATA = "Indirect Address ", "Indirect Data "


class Refusal(Enum):
    """Why a servo does not take what a packet wants to write."""

    RESERVED = "no register there"
    READ_ONLY = "a register that only the servo writes"
    LENGTH = "a part of a register"
    RANGE = "a value that the register never takes"
    LIMIT = "a value that another register forbids now"
    LOCKED = "EEPROM that cannot be written now"


class Change(NamedTuple):
    """What a write does to one register.

    Attributes:
        register: The register.
        value: What it holds then.
    """

    register: Register
    value: int


class RegisterMemory:
    """Bytes of a control table, with the checks a servo makes before it takes a packet's values.

    Args:
        table: The registers.
        whole: Whether a packet must write registers as a whole, as in protocol 2.0.
    """

    def __init__(self, table: ControlTable, *, whole: bool = False) -> None:
        self.table = table
        self._whole = whole
        self._bytes = bytearray(table.size)
        self._values = {register.name: 0 for register in table}
        self._places = {
            r.name: (r.address, r.end, r.size, r.sign is Sign.TWOS_COMPLEMENT) for r in table
        }
        self._owners: list[Register | None] = [None] * table.size
        for register in table:
            self._owners[register.address : register.end] = [register] * register.size
        self._aliases = {
            table[_DATA + r.name.removeprefix(_ADDRESS)].address: r.name
            for r in table
            if r.name.startswith(_ADDRESS)
        }
        """Names of the registers that say what stands at the address of an Indirect Data."""
        self._first_alias = min(self._aliases, default=table.size)
        self.load_initial_values(Memory.EEPROM)
        self.load_initial_values(Memory.RAM)

    def load_initial_values(self, memory: Memory, *, but: tuple[str, ...] = ()) -> None:
        """Set the registers of EEPROM or RAM to the vendor's values, where there are any."""
        for register in self.table:
            known = register.initial is not None and register.name not in but
            if register.memory is memory and known:
                self[register.name] = register.initial or 0

    def __getitem__(self, name: str) -> int:
        return self._values[name]

    @overload
    def get(self, name: str) -> int | None: ...

    @overload
    def get(self, name: str, default: int) -> int: ...

    def get(self, name: str, default: int | None = None) -> int | None:
        """Return a register that not all models have."""
        return self._values.get(name, default)

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def __setitem__(self, name: str, value: int) -> None:
        """Set a register from inside the servo, whatever a packet may do."""
        if self._values[name] == value:
            return
        start, end, size, signed = self._places[name]
        self._bytes[start:end] = value.to_bytes(size, "little", signed=signed)
        self._values[name] = value

    def read(self, address: int, length: int) -> bytes | None:
        """Return bytes, or None when some of them are behind the table."""
        if length < 1 or address + length > len(self._bytes):
            return None
        return b"".join(bytes(self._bytes[start:end]) for start, end in self._runs(address, length))

    def changes(self, address: int, data: bytes) -> list[Change] | Refusal:
        """Return what a packet's write does to registers, in rising order, or why it may not."""
        if not data:
            return Refusal.LENGTH if self._whole else Refusal.RESERVED
        changes: list[Change] = []
        taken = 0
        for start, end in self._runs(address, len(data)):
            refusal = self._add_changes(changes, start, end, data[taken : taken + end - start])
            if refusal:
                return refusal
            taken += end - start
        return changes

    def _add_changes(
        self, changes: list[Change], start: int, end: int, data: bytes
    ) -> Refusal | None:
        place = start
        while place < end:
            register = self._owners[place] if place < len(self._owners) else None
            if register is None:
                return Refusal.RESERVED
            if not register.writable:
                return Refusal.READ_ONLY
            share = data[place - start : register.end - start]
            if len(share) < register.size:
                if self._whole:
                    return Refusal.LENGTH
                before = self._bytes[register.address : place]
                behind = self._bytes[place + len(share) : register.end]
                share = bytes(before) + share + bytes(behind)
            value = register.decode(share)
            if not register.admits(value):
                return Refusal.RANGE
            changes.append(Change(register, value))
            place = register.end
        return None

    def _runs(self, address: int, length: int) -> Iterator[tuple[int, int]]:
        """Yield begin and end of the bytes meant, after Indirect Data has been looked up."""
        end = address + length
        if end <= self._first_alias:
            yield address, end
            return
        first = last = -1
        for byte in range(address, end):
            place = self._values[self._aliases[byte]] if byte in self._aliases else byte
            if place != last:
                if last >= 0:
                    yield first, last
                first = place
            last = place + 1
        yield first, last
