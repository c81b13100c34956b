"""The program of the processes below the supervisor, and their messages.

Usage: python -m head_tracking.run.child control|vision|page FD ARGUMENTS...
"""

from __future__ import annotations

import gc
import json
import os
import queue
import signal
import socket
import sys
import threading
from contextlib import suppress
from typing import Any, Final

from head_tracking.output import tolerate_output_errors
from head_tracking.ros.kit.stop_signal import ENDING, StopSignal
from head_tracking.run.node_sets import CONTROL

END: Final = {"end": True}
"""The message that asks a process to end."""

_MAX_SIZE: Final = 1 << 16  # bytes of a message
_END_TIMEOUT: Final = 10  # s; longer than the supervisor waits before it kills the process


class Channel:
    """One end of a socket pair that carries JSON objects, one in each packet.

    Args:
        connection: a socket of type SOCK_SEQPACKET.
    """

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection

    def fileno(self) -> int:
        """Return the file descriptor, for a selector."""
        return self._connection.fileno()

    def send(self, **message: Any) -> None:
        """Send a message, unless the other end is closed."""
        with suppress(OSError):
            self._connection.send(json.dumps(message).encode())

    def receive(self) -> dict[str, Any] | None:
        """Wait for a message and return it; return None when the other end is closed."""
        data = b""
        with suppress(OSError):
            data = self._connection.recv(_MAX_SIZE)
        return json.loads(data) if data else None

    def close(self) -> None:
        """Close this end."""
        self._connection.close()


class SupervisorLink(Channel):
    """The channel to the supervisor.

    Args:
        stop: is set when the supervisor has closed its end, or was killed.

    Attributes:
        messages: from the supervisor.
        has_crashed: whether the supervisor has ended without asking this process to end.
    """

    def __init__(self, descriptor: int, stop: StopSignal) -> None:
        super().__init__(socket.socket(fileno=descriptor))
        self._stop = stop
        self.messages: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self.has_crashed = False
        threading.Thread(target=self._read, name="supervisor", daemon=True).start()

    def _read(self) -> None:
        try:
            while (message := self.receive()) not in (None, END):
                self.messages.put(message)
            self.has_crashed = message is None
        finally:
            # a process that hangs while it ends would stay for ever after a killed supervisor
            signal.alarm(_END_TIMEOUT)
            self._stop.set()


def main() -> int:
    """Run a process until a signal or until the supervisor ends; return the exit code."""
    process, descriptor, *arguments = sys.argv[1:]
    stop = StopSignal()
    link = SupervisorLink(int(descriptor), stop)
    for number in ENDING:  # end at once: nothing runs yet
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda *_: os._exit(0))
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)  # the supervisor has blocked them
    if process == CONTROL:
        from head_tracking.run.control import run_control as run
    else:
        from head_tracking.run.node_process import run_nodes as run
    tolerate_output_errors()
    with stop:
        code = run(arguments, stop, link)
    gc.freeze()  # the last garbage collection would take 0.1 s of processor time
    return code


if __name__ == "__main__":
    raise SystemExit(main())
