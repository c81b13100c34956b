"""A program with a STOP key; its lines are for the test that types into its terminal."""

import os
import sys
import time

from head_tracking.ros.stop_signal import StopSignal
from head_tracking.run.stop_key import StopKey


def said(words: str) -> list[str]:
    return [words]


def main(way: str) -> None:
    def say(line: str) -> None:
        print(f"<{line}>", flush=True)

    with (
        StopSignal() as stop,
        StopKey(lambda: said("pan relaxed"), lambda: said("slowly"), say) as key,
    ):
        say(f"process {os.getpid()}")
        say(f"keys work: {key.works}")
        if way == "error":
            raise RuntimeError("the program's own")
        if way == "exit":
            sys.exit(0)
        end = time.monotonic() + 60.0
        while not stop() and time.monotonic() < end:
            stop.wait(0.1)


if __name__ == "__main__":
    main(sys.argv[1])
