"""Runs head_tracking and prints the duration of each cycle of its servo bus [s].

Usage: timed_run.py ARGUMENT ...; the last output line that begins with a bracket is a JSON list.
The bus runs in the control process, which this program replaces by itself.
"""

import json
import runpy
import subprocess
import sys
import time
from typing import Any

from head_tracking.dynamixel import BusReading
from head_tracking.dynamixel.cycle import Cycle
from head_tracking.run.supervisor import main

CHILD = "head_tracking.run.child"

durations: list[float] = []


class _Stopwatch:
    begin = 0.0


def timed() -> None:
    """Measure the time from the start of each read to the end of the write."""
    read, write = Cycle.read, Cycle.write

    def timed_read(cycle: Cycle) -> BusReading:
        _Stopwatch.begin = time.perf_counter()
        return read(cycle)

    def timed_write(cycle: Cycle, reading: BusReading) -> BusReading:
        written = write(cycle, reading)
        durations.append(time.perf_counter() - _Stopwatch.begin)
        return written

    Cycle.read, Cycle.write = timed_read, timed_write  # type: ignore[method-assign]


def start_control_with_this_program() -> None:
    """Replace the command of the control process, which the supervisor starts."""
    start = subprocess.Popen.__init__

    def started(process: Any, command: list[str], **options: Any) -> None:
        if command[1:4] == ["-m", CHILD, "control"]:
            command = [command[0], __file__, *command[2:]]
        start(process, command, **options)

    subprocess.Popen.__init__ = started  # type: ignore[assignment, method-assign]


if __name__ == "__main__":
    if sys.argv[1] != CHILD:
        start_control_with_this_program()
        sys.exit(main())
    timed()
    del sys.argv[0]
    try:
        runpy.run_module(CHILD, run_name="__main__")
    finally:
        print(json.dumps([round(seconds, 6) for seconds in durations]), flush=True)
