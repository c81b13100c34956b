"""A signal ends a program whenever it comes."""

import subprocess
import sys

PROGRAM = """
import inspect, signal, sys, threading
from head_tracking.ros.kit.stop_signal import StopSignal

lines, first = inspect.getsourcelines(threading.Event.wait)
locked = first + next(i for i, line in enumerate(lines) if "= self._flag" in line)

def interrupt(frame, event, argument):
    if frame.f_code is threading.Event.wait.__code__ and frame.f_lineno == locked:
        sys.settrace(None)
        signal.raise_signal(signal.SIGINT)
        return None
    return interrupt

with StopSignal() as stop:
    sys.settrace(interrupt)
    while not stop.wait(0.01):
        pass
print("ended")
"""


def test_a_signal_is_noticed_while_an_event_is_locked():
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=60.0, check=True
    )
    assert done.stdout == "ended\n"
