"""Packets of both protocols with known bytes (shared fact sheet, section 4)."""

from __future__ import annotations

from simulated_packets import InstructionPacket, InstructionPacket2, StatusPacket, StatusPacket2

from head_tracking.dynamixel.protocol import ErrorBits

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

Packet2 = InstructionPacket2

INSTRUCTIONS_2 = {
    "ping 1": ("FF FF FD 00 01 03 00 01 19 4E", Packet2.ping(1)),
    "ping all": ("FF FF FD 00 FE 03 00 01 31 42", Packet2.ping()),
    "read position": ("FF FF FD 00 01 07 00 02 84 00 04 00 1D 15", Packet2.read(1, 132, 4)),
    "goal 512": (
        "FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89",
        Packet2.write(1, 116, b"\x00\x02\x00\x00"),
    ),
    "torque on": ("FF FF FD 00 01 06 00 03 40 00 01 DB 66", Packet2.write(1, 64, b"\x01")),
    "stuffed goal": (
        "FF FF FD 00 01 0A 00 03 74 00 FF FF FD FD 00 21 E7",
        Packet2.write(1, 116, b"\xff\xff\xfd\x00"),
    ),
    "action 1": ("FF FF FD 00 01 03 00 05 02 CE", Packet2.action(1)),
    "factory reset but id": ("FF FF FD 00 01 04 00 06 01 A1 E6", Packet2(1, 0x06, b"\x01")),
    "reboot 1": ("FF FF FD 00 01 03 00 08 2F 4E", Packet2.reboot(1)),
    "clear turns": (
        "FF FF FD 00 01 08 00 10 01 44 58 4C 22 B1 DC",
        Packet2(1, 0x10, b"\x01\x44\x58\x4c\x22"),
    ),
    "sync read position": (
        "FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA",
        Packet2.sync_read(132, 4, (1, 2)),
    ),
    "sync read feedback": (
        "FF FF FD 00 FE 09 00 82 7E 00 0A 00 01 02 38 92",
        Packet2.sync_read(126, 10, (1, 2)),
    ),
    "sync write goals": (
        "FF FF FD 00 FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87",
        Packet2.sync_write(116, {1: b"\x96\0\0\0", 2: b"\xaa\0\0\0"}),
    ),
    "bulk read": (
        "FF FF FD 00 FE 0D 00 92 01 90 00 02 00 02 92 00 01 00 1A 05",
        Packet2.bulk_read({1: (144, 2), 2: (146, 1)}),
    ),
    "fast sync read": (
        "FF FF FD 00 FE 0A 00 8A 84 00 04 00 03 07 04 20 F2",
        Packet2.sync_read(132, 4, (3, 7, 4), fast=True),
    ),
}

STATUSES_2 = {
    "ping of an XM430": (
        "FF FF FD 00 01 07 00 55 00 06 04 26 65 5D",
        StatusPacket2(1, data=b"\x06\x04\x26"),
    ),
    "position 166": (
        "FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0",
        StatusPacket2(1, data=b"\xa6\0\0\0"),
    ),
    "position -1": (
        "FF FF FD 00 01 08 00 55 00 FF FF FF FF 96 38",
        StatusPacket2(1, data=b"\xff\xff\xff\xff"),
    ),
    "ok": ("FF FF FD 00 01 04 00 55 00 A1 0C", StatusPacket2(1)),
    "access error": ("FF FF FD 00 01 04 00 55 07 B0 8C", StatusPacket2(1, 7)),
    "alert": ("FF FF FD 00 01 04 00 55 80 A2 8F", StatusPacket2(1, 0x80)),
}
