"""Packets of protocol 1.0 with known bytes (shared fact sheet, section 4, protocol 1.0)."""

from __future__ import annotations

from head_tracking.dynamixel import ErrorBits
from head_tracking.simulation import InstructionPacket, StatusPacket

Packet = InstructionPacket

INSTRUCTIONS = {
    "ping 1": ("FF FF 01 02 01 FB", Packet.ping(1)),
    "read temperature": ("FF FF 01 04 02 2B 01 CC", Packet.read(1, 43, 1)),
    "read position": ("FF FF 01 04 02 24 02 D2", Packet.read(1, 36, 2)),
    "read 36..43": ("FF FF 01 04 02 24 08 CC", Packet.read(1, 36, 8)),
    "read model": ("FF FF 01 04 02 00 02 F6", Packet.read(1, 0, 2)),
    "torque on": ("FF FF 01 04 03 18 01 DE", Packet.write(1, 24, b"\x01")),
    "torque off": ("FF FF 01 04 03 18 00 DF", Packet.write(1, 24, b"\x00")),
    "goal 512": ("FF FF 01 05 03 1E 00 02 D6", Packet.write(1, 30, b"\x00\x02")),
    "goal 512, speed 100": (
        "FF FF 01 07 03 1E 00 02 64 00 70",
        Packet.write(1, 30, b"\x00\x02\x64\x00"),
    ),
    "torque limit 1023": ("FF FF 01 05 03 22 FF 03 D2", Packet.write(1, 34, b"\xff\x03")),
    "broadcast id := 1": ("FF FF FE 04 03 03 01 F6", Packet.write(254, 3, b"\x01")),
    "broadcast torque off": ("FF FF FE 04 03 18 00 E2", Packet.write(254, 24, b"\x00")),
    "reg write goal 500": ("FF FF 01 05 04 1E F4 01 E2", Packet.reg_write(1, 30, b"\xf4\x01")),
    "action": ("FF FF FE 02 05 FA", Packet.action()),
    "factory reset 0": ("FF FF 00 02 06 F7", Packet.factory_reset(0)),
    "sync write ids 0, 1": (
        "FF FF FE 0E 83 1E 04 00 10 00 50 01 01 20 02 60 03 67",
        Packet.sync_write(30, {0: b"\x10\x00\x50\x01", 1: b"\x20\x02\x60\x03"}),
    ),
    "sync write goals 512, 300": (
        "FF FF FE 0A 83 1E 02 01 00 02 02 2C 01 22",
        Packet.sync_write(30, {1: b"\x00\x02", 2: b"\x2c\x01"}),
    ),
    "sync write goals and speeds": (
        "FF FF FE 0E 83 1E 04 01 00 02 64 00 02 2C 01 64 00 54",
        Packet.sync_write(30, {1: b"\x00\x02\x64\x00", 2: b"\x2c\x01\x64\x00"}),
    ),
    "bulk read": (
        "FF FF FE 09 92 00 02 01 1E 02 02 24 1D",
        Packet(254, 0x92, bytes.fromhex("00 02 01 1E 02 02 24")),
    ),
}

STATUSES = {
    "ping": ("FF FF 01 02 00 FC", StatusPacket(1)),
    "temperature 32": ("FF FF 01 03 00 20 DB", StatusPacket(1, data=b"\x20")),
    "position 512": ("FF FF 01 04 00 00 02 F8", StatusPacket(1, data=b"\x00\x02")),
    "36..43": (
        "FF FF 01 0A 00 00 02 00 00 00 00 78 1E 5C",
        StatusPacket(1, data=bytes.fromhex("00 02 00 00 00 00 78 1E")),
    ),
    "model 12": ("FF FF 01 04 00 0C 00 EE", StatusPacket(1, data=b"\x0c\x00")),
    "factory reset 0": ("FF FF 00 02 00 FD", StatusPacket(0)),
    "angle limit": ("FF FF 01 02 02 FA", StatusPacket(1, ErrorBits.ANGLE_LIMIT)),
    "range": ("FF FF 01 02 08 F4", StatusPacket(1, ErrorBits.RANGE)),
    "checksum": ("FF FF 01 02 10 EC", StatusPacket(1, ErrorBits.CHECKSUM)),
    "instruction": ("FF FF 01 02 40 BC", StatusPacket(1, ErrorBits.INSTRUCTION)),
    "overload, overheating": (
        "FF FF 01 02 24 D8",
        StatusPacket(1, ErrorBits.OVERLOAD | ErrorBits.OVERHEATING),
    ),
    "overload, position 512": (
        "FF FF 01 04 20 00 02 D8",
        StatusPacket(1, ErrorBits.OVERLOAD, b"\x00\x02"),
    ),
}
