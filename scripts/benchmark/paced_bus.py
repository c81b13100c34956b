"""AX servos behind a pseudo-terminal, with the timing of a 1 Mbaud line, in a process of its own.

It has registers, checks checksums, supports ping, read, write and sync write, and polls without a
pause to reply in time. For `scripts/benchmark/measure bus`. `simulated_bus` has servos that move.

Usage: paced_bus.py RETURN_DELAY_US [ID ...]; prints the port to open. SIGUSR1 silences the servos
with these ids.
"""

from __future__ import annotations

import ctypes
import os
import select
import signal
import sys
import time
import tty
from contextlib import suppress

BYTE = 10e-6  # s at 1 Mbit/s
IDS = (1, 2)
POSITION = 36
PR_SET_TIMERSLACK = 29


def main() -> None:
    """Reply to packets until the process is ended."""
    delay = float(sys.argv[1]) * 1e-6
    silent: set[int] = set()
    signal.signal(signal.SIGUSR1, lambda *_: silent.update(map(int, sys.argv[2:])))
    ctypes.CDLL(None).prctl(PR_SET_TIMERSLACK, 1)
    with suppress(OSError):
        os.nice(-19)  # keep the timing on a busy machine
    master, slave = os.openpty()
    tty.setraw(slave)
    print(os.ttyname(slave), flush=True)
    memory = {servo_id: bytearray(64) for servo_id in IDS}
    for registers in memory.values():
        registers[0:2] = (12).to_bytes(2, "little")
        registers[16] = 2
        registers[8:10] = (1023).to_bytes(2, "little")
        registers[11], registers[14:16], registers[18] = 70, b"\xff\x03", 36
        registers[34:36] = b"\xff\x03"
        registers[36:44] = bytes((0, 2, 0, 0, 0, 0, 120, 30))
    wire_free = 0.0
    buffer = b""
    poll = select.poll()
    poll.register(master, select.POLLIN)
    while True:
        poll.poll()
        now = time.monotonic()
        data = os.read(master, 4096)
        wire_free = max(wire_free, now) + len(data) * BYTE
        buffer += data
        while (packet := take(buffer)) is not None:
            buffer = buffer[len(packet) :]
            answer = obey(packet, memory)
            if answer and packet[2] not in silent:
                wire_free += delay + len(answer) * BYTE
                while time.monotonic() < wire_free:
                    pass
                os.write(master, answer)


def take(buffer: bytes) -> bytes | None:
    """Return the first packet of a buffer, or None if it is incomplete."""
    if len(buffer) < 6 or len(buffer) < buffer[3] + 4:
        return None
    packet = buffer[: buffer[3] + 4]
    assert packet[:2] == b"\xff\xff" and sum(packet[2:]) & 0xFF == 0xFF, packet.hex(" ")
    return packet


def obey(packet: bytes, memory: dict[int, bytearray]) -> bytes:
    """Execute an instruction; return the reply, or nothing."""
    servo_id, instruction, parameters = packet[2], packet[4], packet[5:-1]
    if instruction == 0x83:
        address, size = parameters[:2]
        for start in range(2, len(parameters), size + 1):
            share = parameters[start : start + size + 1]
            memory[share[0]][address : address + size] = share[1:]
        return b""
    data = b""
    if instruction == 0x02:
        data = bytes(memory[servo_id][parameters[0] : parameters[0] + parameters[1]])
    elif instruction == 0x03:
        memory[servo_id][parameters[0] : parameters[0] + len(parameters) - 1] = parameters[1:]
    body = bytes((servo_id, len(data) + 2, 0)) + data
    return b"\xff\xff" + body + bytes((~sum(body) & 0xFF,))


if __name__ == "__main__":
    main()
