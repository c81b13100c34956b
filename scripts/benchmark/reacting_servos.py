"""Two AX-12 behind a pty, a process of its own, that tells how soon its readings are answered.

Usage: reacting_servos.py [shaking]; prints the port to open, and at its end, by SIGTERM, one line
of JSON, all times from the last byte of a reading to the arrival of a packet of goals:
"first": CLOCK_MONOTONIC of the first packet, ns; "next": how soon the next packet came, s;
"answers": for shaking servos, how soon the packet came that was made from this reading, s.

Shaking servos say in every cycle that they stand a few ticks aside, never twice the same. The
tutorials' law aims at `lead_target_angle` from where a joint says that it is: so a packet tells
from which reading it was made.
"""

from __future__ import annotations

import json
import math
import select
import signal
import sys
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from random import Random

from head_tracking.simulation import Answer, SerialLine, SimulatedBus, SimulatedServo
from head_tracking.simulation.port import PseudoTerminal

LEAD = 0.3  # rad, the lead_target_angle of who is to be measured with shaking servos
IDS = (1, 2)
_LEAD_TICKS = math.degrees(LEAD) / (300.0 / 1023.0)
_GOALS, _STATUS = 0x83, 14  # instruction sync write; length of a status with 8 bytes
_STEP, _STEPS = 2, 16  # ticks; positions aside that a servo says at most


@dataclass(slots=True)
class Reading:
    """What both servos said in one cycle [ticks], and when the last one had."""

    positions: dict[int, int]
    time: int = 0


class ReactingServos:
    """Stands between the bus's answers and the pty; keeps what was read and how it was answered."""

    def __init__(self, shaking: bool) -> None:
        self.readings: deque[Reading] = deque([Reading({})], maxlen=6)
        self.next: list[float] = []
        self.answers: list[float] = []
        self._random = Random(1) if shaking else None

    def line(self, answer: Answer) -> Iterator[Answer]:
        """What becomes of a servo's answer."""
        data = bytearray(answer.data)
        if len(data) == _STATUS:
            aside = self._random.randrange(_STEPS) * _STEP if self._random else 0
            position = int.from_bytes(data[5:7], "little") + aside
            data[5:7] = position.to_bytes(2, "little")
            data[-1] = ~sum(data[2:-1]) & 0xFF
            if data[2] == IDS[0]:
                self.readings.append(Reading({}))
            self.readings[-1].positions[data[2]] = position
        yield replace(answer, data=bytes(data))

    def sent(self, now: int) -> None:
        """An answer's last byte went out."""
        self.readings[-1].time = now

    def heard(self, data: bytes, now: int) -> None:
        """Takes the time of a packet of goals."""
        start = data.find(b"\xff\xff\xfe")
        if start < 0 or data[start + 4 : start + 5] != bytes((_GOALS,)):
            return
        width = data[start + 6] + 1
        shares = data[start + 7 : start + 3 + data[start + 3]]
        goals = {
            shares[at]: int.from_bytes(shares[at + 1 : at + 3], "little")
            for at in range(0, len(shares), width)
        }
        if set(goals) != set(IDS):
            return
        self.next.append((now - self.readings[-1].time) * 1e-9)
        if self._random is None:
            return
        for reading in reversed(self.readings):
            ahead = [goal - reading.positions.get(joint, 0) for joint, goal in goals.items()]
            if all(abs(abs(ticks) - _LEAD_TICKS) <= 1.0 for ticks in ahead):
                self.answers.append((now - reading.time) * 1e-9)
                return


def main() -> None:
    """Serves until SIGTERM."""
    servos = [SimulatedServo(number, position=512) for number in IDS]
    for servo in servos:
        servo.set_register("Return Delay Time", 0)
    reacting = ReactingServos("shaking" in sys.argv[1:])
    bus = SimulatedBus(servos, reacting.line)
    line = SerialLine(bus)
    terminal = PseudoTerminal()
    ending: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: ending.append(number))
    print(terminal.name, flush=True)
    first = 0
    while not ending:
        ready = select.select([terminal.descriptor], (), (), 0.02)[0]
        now = time.monotonic_ns()
        if ready:
            first = first or now
            data = terminal.read()
            reacting.heard(data, now)
            line.send(data, now, 0)
        else:
            bus.advance(now)
        if answer := line.take(now):
            terminal.write(answer)
            reacting.sent(time.monotonic_ns())
    print(json.dumps({"first": first, "next": reacting.next, "answers": reacting.answers}))


if __name__ == "__main__":
    main()
