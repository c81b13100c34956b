"""The head with its usual arguments; at its end, how long the cycles of its servo bus took, s.

Usage: timed_run.py ARGUMENT ...; the last line of the output is a JSON list.
"""

from __future__ import annotations

import json
import sys
import time

from head_tracking.__main__ import main
from head_tracking.dynamixel import BusEvent, BusReading
from head_tracking.dynamixel.cycle import Cycle

took: list[float] = []


class _Stopwatch:
    begin = 0.0


def timed() -> None:
    """Take the time from the begin of each bus's read to the end of its write."""
    read, write = Cycle.read, Cycle.write

    def timed_read(cycle: Cycle) -> BusReading:
        _Stopwatch.begin = time.perf_counter()
        return read(cycle)

    def timed_write(cycle: Cycle) -> tuple[BusEvent, ...]:
        events = write(cycle)
        took.append(time.perf_counter() - _Stopwatch.begin)
        return events

    Cycle.read, Cycle.write = timed_read, timed_write  # type: ignore[method-assign]


if __name__ == "__main__":
    timed()
    try:
        code = main()
    finally:
        print(json.dumps([round(seconds, 6) for seconds in took]), flush=True)
    sys.exit(code)
