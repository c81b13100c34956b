"""A signal ends a program whenever it comes."""

import subprocess
import sys

import pytest

PROGRAM = """
import signal, sys
from head_tracking.ros.kit.stop_signal import StopSignal

def interrupt(frame, event, argument):
    global left
    left -= event == "line"
    if left == 0:
        signal.raise_signal(signal.SIGINT)
    return interrupt

for line in range(1, 60):  # of `wait` and of what it calls
    with StopSignal() as stop:
        left = line
        wait = stop.wait
        sys.settrace(interrupt)
        while not wait(0.001):
            pass
        sys.settrace(None)
        assert stop() and wait(5.0)
print("ended")
"""


def test_a_signal_is_noticed_in_every_line_of_the_wait_for_it():
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=60.0, check=True
    )
    assert done.stdout == "ended\n"


@pytest.mark.parametrize("moment", ["before", "meanwhile"])
def test_a_program_that_still_imports_ends_at_once(moment):
    code = (
        "from head_tracking.ros.kit.stop_signal import StopSignal\n"
        "with StopSignal() as stop:\n"
        f"    {moment!r} == 'before' and stop.set()\n"
        "    with stop.while_importing():\n"
        f"        {moment!r} == 'meanwhile' and stop.set()\n"
        "        raise SystemExit('it imports')\n"
    )
    subprocess.run([sys.executable, "-c", code], timeout=60.0, check=True)
