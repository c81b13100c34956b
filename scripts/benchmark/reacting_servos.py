"""Two simulated AX-12 in a process of their own, which measure how fast their readings are used.

Usage: reacting_servos.py [shaking]. It prints the port to open, and after SIGTERM one line of JSON:
"first": time of the first packet by CLOCK_MONOTONIC [ns];
"next": times from the last byte of a reading to the next packet of goals [s];
"answers": for shaking servos, times to the packet of goals that was computed from the reading [s].

Shaking servos report a random offset in every cycle. The law speed aims at `lead_target_angle` from
the measured position, so a goal shows the reading from which it was computed.
"""

from __future__ import annotations

import json
import math
import select
import signal
import sys
import time
from collections import deque
from dataclasses import dataclass, replace
from random import Random

from head_tracking.simulation import Answer, Faults, SerialLine, SimulatedBus, SimulatedServo
from head_tracking.simulation.port import PseudoTerminal

LEAD = 0.3  # rad, the lead_target_angle of the measured tracker
IDS = (1, 2)
_LEAD_TICKS = math.degrees(LEAD) / (300.0 / 1023.0)
_GOALS, _STATUS = 0x83, 14  # instruction sync write; length of a status with 8 bytes
_STEP, _STEPS = 2, 16  # ticks; number of different offsets


@dataclass(slots=True)
class Reading:
    """The positions of both servos in one cycle [ticks], and the time of the last byte [ns]."""

    positions: dict[int, int]
    time: int = 0


class ReactingServos(Faults):
    """Changes the answers of the servos, and records readings and the times of their goals."""

    def __init__(self, shaking: bool) -> None:
        super().__init__(Random(1), 0.0)
        self.readings: deque[Reading] = deque([Reading({})], maxlen=6)
        self.next: list[float] = []
        self.answers: list[float] = []
        self._shaking = Random(1) if shaking else None

    def answer(self, answer: Answer) -> list[Answer]:
        """Return a servo's answer with the offset."""
        data = bytearray(answer.data)
        if len(data) == _STATUS:
            offset = self._shaking.randrange(_STEPS) * _STEP if self._shaking else 0
            position = int.from_bytes(data[5:7], "little") + offset
            data[5:7] = position.to_bytes(2, "little")
            data[-1] = ~sum(data[2:-1]) & 0xFF
            if data[2] == IDS[0]:
                self.readings.append(Reading({}))
            self.readings[-1].positions[data[2]] = position
        return [replace(answer, data=bytes(data))]

    def sent(self, now: int) -> None:
        """Record the time when the last byte of an answer was sent."""
        self.readings[-1].time = now

    def received(self, data: bytes, now: int) -> None:
        """Record the time of a packet of goals."""
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
        if self._shaking is None:
            return
        for reading in reversed(self.readings):
            ahead = [goal - reading.positions.get(joint, 0) for joint, goal in goals.items()]
            if all(abs(abs(ticks) - _LEAD_TICKS) <= 1.0 for ticks in ahead):
                self.answers.append((now - reading.time) * 1e-9)
                return


def main() -> None:
    """Serve the servos until SIGTERM."""
    servos = [SimulatedServo(number, position=512) for number in IDS]
    for servo in servos:
        servo.set_register("Return Delay Time", 0)
    reacting = ReactingServos("shaking" in sys.argv[1:])
    bus = SimulatedBus(servos, faults=reacting)
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
            reacting.received(data, now)
            line.send(data, now, 0)
        else:
            bus.advance(now)
        if answer := line.receive(now):
            terminal.write(answer)
            reacting.sent(time.monotonic_ns())
    print(json.dumps({"first": first, "next": reacting.next, "answers": reacting.answers}))


if __name__ == "__main__":
    main()
