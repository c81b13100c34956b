"""The memory of a simulated servo: its control table as bytes."""

from __future__ import annotations

from head_tracking.dynamixel.control_table import ControlTable, Memory, Register
from head_tracking.dynamixel.protocol1 import NO_ERROR, ErrorBits


class RegisterMemory:
    """Bytes of a control table, with the checks a servo makes before it takes a packet's values.

    Args:
        table: The registers.
    """

    def __init__(self, table: ControlTable) -> None:
        self.table = table
        self._bytes = bytearray(table.size)
        self._places = {register.name: slice(register.address, register.end) for register in table}
        self._owners: list[str | None] = [None] * table.size
        for register in table:
            self._owners[register.address : register.end] = [register.name] * register.size
        self.load_initial_values(Memory.EEPROM)
        self.load_initial_values(Memory.RAM)

    def load_initial_values(self, memory: Memory) -> None:
        """Set the registers of EEPROM or RAM to the vendor's values, where there are any."""
        for register in self.table:
            if register.memory is memory and register.initial is not None:
                self[register.name] = register.initial

    def __getitem__(self, name: str) -> int:
        return int.from_bytes(self._bytes[self._places[name]], "little")

    def __setitem__(self, name: str, value: int) -> None:
        """Set a register from inside the servo, whatever a packet may do."""
        place = self._places[name]
        self._bytes[place] = value.to_bytes(place.stop - place.start, "little")

    def read(self, address: int, length: int) -> bytes | None:
        """Return bytes, or None when some of them are behind the table."""
        if length < 1 or address + length > len(self._bytes):
            return None
        return bytes(self._bytes[address : address + length])

    def touched(self, address: int, length: int) -> list[Register]:
        """Return the registers that own at least one of the bytes, in rising order."""
        owners = self._owners[address : address + length]
        return [self.table[owner] for owner in dict.fromkeys(owners) if owner is not None]

    def check(self, address: int, data: bytes) -> ErrorBits:
        """Return why a packet may not write these bytes, or no error; changes nothing."""
        owners = self._owners[address : address + len(data)]
        if not data or len(owners) < len(data) or None in owners:
            return ErrorBits.RANGE
        for register in self.touched(address, len(data)):
            if not register.admits(self.value_after(register, address, data)):
                return ErrorBits.RANGE
            if register.memory is Memory.EEPROM and self["Lock"]:
                return ErrorBits.RANGE
        return NO_ERROR

    def value_after(self, register: Register, address: int, data: bytes) -> int:
        """Return what a register would hold after a write."""
        after = bytearray(self._bytes[register.address : register.end])
        for index in range(register.size):
            source = register.address + index - address
            if 0 <= source < len(data):
                after[index] = data[source]
        return int.from_bytes(after, "little")

    def write(self, address: int, data: bytes) -> bool:
        """Write bytes that `check` has found good; return whether they are new."""
        place = slice(address, address + len(data))
        changed = self._bytes[place] != data
        self._bytes[place] = data
        return changed
