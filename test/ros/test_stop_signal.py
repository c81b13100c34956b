"""A signal ends a program whenever it comes."""

import signal
import socket
import subprocess
import sys

from waiting import PATIENCE

from head_tracking.ros.kit.stop_signal import ENDING

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
    command = [sys.executable, "-c", PROGRAM]
    assert subprocess.check_output(command, text=True, timeout=PATIENCE) == "ended\n"


def test_a_process_of_a_run_that_still_imports_ends_at_once():
    ours, theirs = socket.socketpair(type=socket.SOCK_SEQPACKET)
    command = [sys.executable, "-m", "head_tracking.run.child", "control", str(theirs.fileno())]
    with ours, theirs:
        before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
        process = subprocess.Popen([*command, "--sim"], pass_fds=[theirs.fileno()])
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE) == 0
        theirs.close()
        assert ours.recv(100) == b""  # what has run reports its end
