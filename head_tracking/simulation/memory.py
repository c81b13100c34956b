"""The memory of a simulated servo: its control table as bytes."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from typing import overload

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
        self._places = {register.name: slice(register.address, register.end) for register in table}
        self._signed = {r.name for r in table if r.sign is Sign.TWOS_COMPLEMENT}
        self._owners: list[str | None] = [None] * table.size
        for register in table:
            self._owners[register.address : register.end] = [register.name] * register.size
        self._aliases = {
            table[_DATA + r.name.removeprefix(_ADDRESS)].address: r.name
            for r in table
            if r.name.startswith(_ADDRESS)
        }
        """Names of the registers that say what stands at the address of an Indirect Data."""
        self.load_initial_values(Memory.EEPROM)
        self.load_initial_values(Memory.RAM)

    def load_initial_values(self, memory: Memory, *, but: tuple[str, ...] = ()) -> None:
        """Set the registers of EEPROM or RAM to the vendor's values, where there are any."""
        for register in self.table:
            if register.memory is not memory or register.initial is None or register.name in but:
                continue
            self[register.name] = register.initial

    def __contains__(self, name: str) -> bool:
        return name in self._places

    def __getitem__(self, name: str) -> int:
        data = self._bytes[self._places[name]]
        return int.from_bytes(data, "little", signed=name in self._signed)

    @overload
    def get(self, name: str) -> int | None: ...

    @overload
    def get(self, name: str, default: int) -> int: ...

    def get(self, name: str, default: int | None = None) -> int | None:
        """Return a register that not all models have."""
        return self[name] if name in self._places else default

    def __setitem__(self, name: str, value: int) -> None:
        """Set a register from inside the servo, whatever a packet may do."""
        place = self._places[name]
        size = place.stop - place.start
        self._bytes[place] = value.to_bytes(size, "little", signed=name in self._signed)

    def read(self, address: int, length: int) -> bytes | None:
        """Return bytes, or None when some of them are behind the table."""
        if length < 1 or address + length > len(self._bytes):
            return None
        if not self._aliases:
            return bytes(self._bytes[address : address + length])
        return b"".join(bytes(self._bytes[start:end]) for start, end in self._runs(address, length))

    def touched(self, address: int, length: int) -> list[Register]:
        """Return the registers that own at least one of the bytes, in rising order."""
        names: dict[str, None] = {}
        for start, end in self._runs(address, length):
            names.update((name, None) for name in self._owners[start:end] if name is not None)
        return [self.table[name] for name in names]

    def check(self, address: int, data: bytes) -> Refusal | None:
        """Return why a packet may not write these bytes; changes nothing."""
        if not data:
            return Refusal.LENGTH if self._whole else Refusal.RESERVED
        taken = 0
        for start, end in self._runs(address, len(data)):
            share, taken = data[taken : taken + end - start], taken + end - start
            refusal = self._check(start, share)
            if refusal:
                return refusal
        return None

    def _check(self, address: int, data: bytes) -> Refusal | None:
        owners = self._owners[address : address + len(data)]
        if len(owners) < len(data) or None in owners:
            return Refusal.RESERVED
        for name in dict.fromkeys(owners):
            assert name is not None
            register = self.table[name]
            if not register.writable:
                return Refusal.READ_ONLY
            if self._whole and owners.count(name) < register.size:
                return Refusal.LENGTH
            if not register.admits(self._value_after(register, address, data)):
                return Refusal.RANGE
        return None

    def values_after(self, address: int, data: bytes) -> Iterator[tuple[Register, int]]:
        """Yield the registers that a write touches, and what they would hold after it."""
        taken = 0
        for start, end in self._runs(address, len(data)):
            share, taken = data[taken : taken + end - start], taken + end - start
            for name in dict.fromkeys(self._owners[start:end]):
                if name is not None:
                    register = self.table[name]
                    yield register, self._value_after(register, start, share)

    def write(self, address: int, data: bytes) -> bool:
        """Write bytes that `check` has found good; return whether they are new."""
        changed, taken = False, 0
        for start, end in self._runs(address, len(data)):
            share, taken = data[taken : taken + end - start], taken + end - start
            changed |= self._bytes[start:end] != share
            self._bytes[start:end] = share
        return changed

    def _value_after(self, register: Register, address: int, data: bytes) -> int:
        after = bytearray(self._bytes[register.address : register.end])
        for index in range(register.size):
            source = register.address + index - address
            if 0 <= source < len(data):
                after[index] = data[source]
        return register.decode(bytes(after))

    def _runs(self, address: int, length: int) -> Iterator[tuple[int, int]]:
        """Yield begin and end of the bytes meant, after Indirect Data has been looked up."""
        end = address + length
        if not any(alias in range(address, end) for alias in self._aliases):
            yield address, end
            return
        first = last = -1
        for byte in range(address, end):
            place = self[self._aliases[byte]] if byte in self._aliases else byte
            if place != last:
                if last >= 0:
                    yield first, last
                first = place
            last = place + 1
        yield first, last
