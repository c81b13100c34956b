"""Two simulated AX-12 in a process of their own, which measure how fast their readings are used.

It prints the port to open, and after SIGTERM one line of JSON:
"first": time of the first packet by CLOCK_MONOTONIC [ns];
"next": times from the last byte of a reading to the next packet of goals [s].
"""

from __future__ import annotations

import json
import select
import signal
import time

from head_tracking.simulation import SerialLine, SimulatedBus, SimulatedServo
from head_tracking.simulation.port import PseudoTerminal

_GOALS = b"\xff\xff\xfe", 0x83  # header of a broadcast; the instruction sync write


def main() -> None:
    """Serve the servos until SIGTERM."""
    servos = [SimulatedServo(number, position=512) for number in (1, 2)]
    for servo in servos:
        servo.set_register("Return Delay Time", 0)
    bus = SimulatedBus(servos)
    line = SerialLine(bus)
    terminal = PseudoTerminal()
    ending: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: ending.append(number))
    print(terminal.name, flush=True)
    first = answered = 0
    times = []
    while not ending:
        ready = select.select([terminal.descriptor], (), (), 0.02)[0]
        now = time.monotonic_ns()
        if ready:
            first = first or now
            data = terminal.read()
            start = data.find(_GOALS[0])
            if start >= 0 and data[start + 4 : start + 5] == bytes((_GOALS[1],)):
                times.append((now - answered) * 1e-9)
            line.send(data, now, 0)
        else:
            bus.advance(now)
        if answer := line.receive(now):
            terminal.write(answer)
            answered = time.monotonic_ns()
    print(json.dumps({"first": first, "next": times}))


if __name__ == "__main__":
    main()
