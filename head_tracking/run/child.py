"""The program of every process below the supervisor, and its line to the supervisor.

    python -m head_tracking.run.child control|vision|page FD ARGUMENTS...

Messages are packets of JSON. The end of the line, which also a killed supervisor brings about, ends
the process.
"""

from __future__ import annotations

import gc
import json
import socket
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final

from head_tracking.output import output_may_get_lost
from head_tracking.ros.kit.stop_signal import StopSignal
from head_tracking.run.node_sets import CONTROL

_LONGEST: Final = 1 << 16  # bytes of a message


class SupervisorLine:
    """Messages to and from the supervisor.

    Args:
        descriptor: of this process's end of the line.
        stop: is set when the supervisor has gone or has ended the line.
    """

    def __init__(self, descriptor: int, stop: StopSignal) -> None:
        self._line = socket.socket(fileno=descriptor)
        self._stop = stop
        self._sending = threading.Lock()
        self._received: Callable[[dict[str, Any]], object] = self._keep
        self._early: list[dict[str, Any]] = []
        self._receiving = threading.Lock()
        threading.Thread(target=self._read, name="supervisor", daemon=True).start()

    def send(self, **message: Any) -> None:
        """Send a message; nothing if the supervisor has gone."""
        with self._sending, suppress(OSError):
            self._line.send(json.dumps(message).encode())

    def receive(self, received: Callable[[dict[str, Any]], object]) -> None:
        """Call back for every message, in a thread of the line; first for those that came early."""
        with self._receiving:
            self._received = received
            for message in self._early:
                received(message)

    def _keep(self, message: dict[str, Any]) -> None:
        self._early.append(message)

    def _read(self) -> None:
        with suppress(OSError):
            while data := self._line.recv(_LONGEST):
                with self._receiving:
                    self._received(json.loads(data))
        self._stop.set()


def main() -> int:
    """Run a process until a signal or the end of the line; return the exit code."""
    process, descriptor, *arguments = sys.argv[1:]
    with output_may_get_lost(), StopSignal() as stop:
        line = SupervisorLine(int(descriptor), stop)
        with stop.while_importing():
            if process == CONTROL:
                from head_tracking.run.control import run_control as run
            else:
                from head_tracking.run.node_process import run_nodes as run
        code = run(arguments, stop, line)
    gc.freeze()  # or Python looks through all that is left once more: 0.1 s of processor time
    return code


if __name__ == "__main__":
    raise SystemExit(main())
