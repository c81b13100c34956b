"""Two simulated AX-12 on a line of 1 Mbit/s, in a process of their own, which also measure.

Usage: servos.py [RETURN_DELAY_US]; prints the port to open. SIGUSR1 takes the power from servo 2.
After SIGTERM it prints one line of JSON:
"first": time of the first packet by CLOCK_MONOTONIC [ns];
"next": times from the last byte of a reading to the next packet of goals [s].
"""

import ctypes
import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from head_tracking.simulation import SerialLine, SimulatedBus, SimulatedServo
from head_tracking.simulation.port import PseudoTerminal

_GOALS = b"\xff\xff\xfe", 0x83  # header of a broadcast; the instruction sync write
_IDLE, _EXACT = 20_000_000, 1_000_000  # ns: longest sleep; before an answer is due there is none
_PR_SET_TIMERSLACK = 29


@contextmanager
def elsewhere(
    return_delay: int = 0,
) -> Iterator[tuple[str, subprocess.Popen[str], dict[str, Any]]]:
    """Run this program; yield its port, its process, and what it measured, filled at the end."""
    measured: dict[str, Any] = {}
    command = [sys.executable, __file__, str(return_delay)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip(), process, measured
        finally:
            process.terminate()
            measured.update(json.loads(process.stdout.read() or "{}"))


def main() -> None:
    """Serve the servos until SIGTERM."""
    bus = SimulatedBus([SimulatedServo(number, position=512) for number in (1, 2)])
    for servo in bus:
        servo.set_register("Return Delay Time", int(*sys.argv[1:]) // 2)
    ending: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: ending.append(number))
    signal.signal(signal.SIGUSR1, lambda *_: bus[2].power_off())
    ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1)
    with suppress(OSError):
        os.nice(-19)  # keep the timing on a busy machine
    line, terminal = SerialLine(bus, paced=True), PseudoTerminal()
    print(terminal.name, flush=True)
    first = answered = 0
    times = []
    while not ending:
        left = _IDLE if line.due is None else line.due - time.monotonic_ns() - _EXACT
        ready = select.select([terminal.descriptor], (), (), max(0, left) * 1e-9)[0]
        now = time.monotonic_ns()
        if ready:
            first = first or now
            data = terminal.read()
            start = data.find(_GOALS[0])
            if start >= 0 and data[start + 4 : start + 5] == bytes((_GOALS[1],)):
                times.append((now - answered) * 1e-9)
            line.send(data, now, 1_000_000)
        elif line.due is None:
            bus.advance(now)
        if answer := line.receive(now):
            terminal.write(answer)
            answered = time.monotonic_ns()
    print(json.dumps({"first": first, "next": times}))


if __name__ == "__main__":
    main()
