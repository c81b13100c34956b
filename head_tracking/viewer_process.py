"""The viewer beside a run, in a process of its own that gives way to the robot and ends with it."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from head_tracking.ros.stop_signal import StopSignal

_NICENESS = 10
_PATIENCE = 5.0  # s


@contextmanager
def viewer_process(arguments: Sequence[str]) -> Iterator[None]:
    """Runs the viewer until the end of the block. If it ends by itself, it says why.

    A process, not a thread: the interpreter lets one thread run at a time, and drawing for three
    browsers takes a fifth of a core that the control loop would have to wait for.

    Args:
        arguments: ROS's own arguments: parameter files, parameters, remaps, namespace.
    """
    theirs, ours = os.pipe()
    process = subprocess.Popen(
        [sys.executable, "-m", "head_tracking.viewer_process", str(theirs), *arguments],
        pass_fds=[theirs],
    )
    os.close(theirs)
    os.setpriority(os.PRIO_PROCESS, process.pid, _NICENESS)
    try:
        yield
    finally:
        os.close(ours)
        process.terminate()
        try:
            process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def main() -> int:
    """Runs the viewer until a signal, or until whoever started it has gone, however that went."""
    lifeline = int(sys.argv[1])
    with StopSignal() as stop:
        threading.Thread(target=_watch, args=(lifeline, stop), daemon=True).start()
        with stop.while_importing():
            from head_tracking.nodes.viewer import ViewerNode
            from head_tracking.ros.spinning import run_until

        return run_until(stop, ViewerNode, sys.argv)


def _watch(lifeline: int, stop: StopSignal) -> None:
    """Nothing is ever written: reading returns when the other end has gone."""
    os.read(lifeline, 1)
    stop.set()
    threading.Event().wait(_PATIENCE)
    os._exit(1)  # something hangs, and keeps the page's port


if __name__ == "__main__":
    raise SystemExit(main())
