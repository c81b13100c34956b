"""However a program that listens for transforms ends, it ends: no abort, no hang, no tracebacks."""

import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from waiting import PATIENCE

PROGRAM = Path(__file__).parents[1] / "support" / "exit_paths.py"

HANGING = """
import sys, time
from head_tracking.ros.kit.stop_signal import StopSignal
from head_tracking.run import child
child._END_TIMEOUT = 1
with StopSignal() as stop:
    child.SupervisorLink(int(sys.argv[1]), stop)
    time.sleep(120)
"""

# what the program does before its end, and whether that is an error of its own
WAYS = [
    ("own", 0),
    ("node error", 1),
    ("node shutdown destroy", 0),
    ("own drop", 0),
    ("node unregister shutdown", 0),
    ("own wait", 0),
    ("node busy", 0),
    ("node interrupt sleeping", -2),
    ("node spin", 0),
]


@pytest.mark.parametrize(("way", "code"), WAYS, ids=[way for way, _ in WAYS])
def test_a_program_ends(way, code):
    ended = subprocess.run(
        [sys.executable, str(PROGRAM), way],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert ended.returncode == code, ended.stderr
    assert ended.stderr.count("Traceback") == (code != 0), ended.stderr


def test_a_process_that_hangs_ends_after_its_supervisor():
    supervisor, channel = socket.socketpair(type=socket.SOCK_SEQPACKET)
    hanging = subprocess.Popen(
        [sys.executable, "-c", HANGING, str(channel.fileno())], pass_fds=[channel.fileno()]
    )
    try:
        channel.close()
        supervisor.close()
        assert hanging.wait(PATIENCE) == -signal.SIGALRM
    finally:
        hanging.kill()
