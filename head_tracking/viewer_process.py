"""The viewer beside a run, in a process of its own that gives way to the robot."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

_NICENESS = 10
_PATIENCE = 5.0  # s


@contextmanager
def viewer_process(arguments: Sequence[str]) -> Iterator[None]:
    """Runs the viewer until the end of the block. If it ends by itself, it says why.

    A process, not a thread: the interpreter lets one thread run at a time, and drawing for three
    browsers takes a fifth of a core that the control loop would have to wait for.

    Args:
        arguments: ROS's own arguments, such as parameter files.
    """
    process = subprocess.Popen([sys.executable, "-m", "head_tracking.nodes.viewer", *arguments])
    os.setpriority(os.PRIO_PROCESS, process.pid, _NICENESS)
    try:
        yield
    finally:
        process.terminate()
        try:
            process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
