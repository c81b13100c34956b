"""The instruction packets of a bus cycle."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Final

from head_tracking.dynamixel.exceptions import CommunicationError
from head_tracking.dynamixel.port import ReadMethod
from head_tracking.dynamixel.protocol1 import BROADCAST_ID, Instruction
from head_tracking.dynamixel.protocol2 import Instruction2
from head_tracking.dynamixel.sdk import instruction_packet

_SYNC_WRITE: Final = int(Instruction.SYNC_WRITE)
_LONGEST_SYNC_WRITE: Final = 240  # bytes of shares that the SDK sends


@lru_cache(maxsize=512)
def read_packet(protocol: int, servo_id: int, address: int, length: int) -> bytes:
    """Return the question for `length` bytes from `address` on."""
    size = 1 if protocol == 1 else 2
    where = address.to_bytes(size, "little") + length.to_bytes(size, "little")
    return instruction_packet(protocol, servo_id, Instruction.READ, where)


@lru_cache(maxsize=128)
def group_packet(method: ReadMethod, ids: tuple[int, ...], address: int, length: int) -> bytes:
    """Return the question for the same bytes of several servos."""
    if method is ReadMethod.BULK:
        shares = (bytes((length, servo_id, address)) for servo_id in ids)
        parameters = b"\x00" + b"".join(shares)
        return instruction_packet(1, BROADCAST_ID, Instruction.BULK_READ, parameters)
    fast = method is ReadMethod.FAST_SYNC
    instruction = Instruction2.FAST_SYNC_READ if fast else Instruction2.SYNC_READ
    where = address.to_bytes(2, "little") + length.to_bytes(2, "little")
    return instruction_packet(2, BROADCAST_ID, instruction, where + bytes(ids))


def sync_write_packet(protocol: int, address: int, data: Mapping[int, bytes]) -> bytes:
    """Return a sync write. It is made anew each cycle, and dynamixel_sdk takes thrice as long.

    Raises:
        CommunicationError: The shares differ in length, or there are too many.
    """
    lengths = set(map(len, data.values()))
    if len(lengths) != 1:
        raise CommunicationError("a sync write needs the same number of bytes for every servo")
    size = lengths.pop()
    shares = b"".join([bytes((servo_id,)) + share for servo_id, share in data.items()])
    if protocol == 2 or len(shares) > _LONGEST_SYNC_WRITE:
        head = address.to_bytes(2 if protocol == 2 else 1, "little")
        head += size.to_bytes(2 if protocol == 2 else 1, "little")
        return instruction_packet(protocol, BROADCAST_ID, Instruction.SYNC_WRITE, head + shares)
    body = bytes((BROADCAST_ID, len(shares) + 4, _SYNC_WRITE, address, size)) + shares
    return b"\xff\xff" + body + bytes((~sum(body) & 0xFF,))
