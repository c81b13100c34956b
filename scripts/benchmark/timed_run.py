"""The head with its usual arguments; at its end, how long the cycles of its servo bus took, s.

Usage: timed_run.py ARGUMENT ...; the last line of the output is a JSON list.
"""

from __future__ import annotations

import json
import sys
import time

from head_tracking.__main__ import main
from head_tracking.dynamixel import BusEvent, BusReading, ServoBus

took: list[float] = []


class _Stopwatch:
    begin = 0.0


def timed() -> None:
    """Take the time from the begin of each bus's read to the end of its write."""
    read, write = ServoBus.read, ServoBus.write

    def timed_read(bus: ServoBus) -> BusReading:
        _Stopwatch.begin = time.perf_counter()
        return read(bus)

    def timed_write(bus: ServoBus) -> tuple[BusEvent, ...]:
        events = write(bus)
        took.append(time.perf_counter() - _Stopwatch.begin)
        return events

    ServoBus.read, ServoBus.write = timed_read, timed_write  # type: ignore[method-assign]


if __name__ == "__main__":
    timed()
    try:
        code = main()
    finally:
        print(json.dumps([round(seconds, 6) for seconds in took]), flush=True)
    sys.exit(code)
