"""A program with a STOP key; its lines are for the test that types into its terminal."""

import os
import select
import signal
import sys
import time

from head_tracking.run.stop_key import StopKey, execute


def main(way: str) -> None:
    def say(line: str) -> None:
        print(f"<{line}>", flush=True)

    suspended: list[int] = []
    ended: list[int] = []
    key = StopKey()
    signal.signal(signal.SIGTSTP, lambda number, _: suspended.append(number))
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
        signal.signal(number, lambda number, _: ended.append(number))
    key.acquire()
    try:
        say(f"process {os.getpid()}")
        say(f"keys work: {key.works}")
        if way == "error":
            raise RuntimeError("the program's own")
        if way == "exit":
            sys.exit(0)
        end = time.monotonic() + 60.0
        while not ended and time.monotonic() < end:
            if suspended:
                suspended.clear()
                key.suspend()
            key.acquire()
            if select.select([key] if key.works else [], [], [], 0.05)[0]:
                pressed = key.read()
                if pressed:
                    say(execute(pressed, lambda: ["pan relaxed"], lambda: ["slowly"]))
    finally:
        key.release()


if __name__ == "__main__":
    main(sys.argv[1])
