"""Messages between the supervisor and the processes of a run."""

from __future__ import annotations

import json
import socket
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, Final

_MAX_SIZE: Final = 1 << 16  # bytes of a message


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

    def send(self, message: Mapping[str, Any]) -> None:
        """Send a message, unless the other end is closed."""
        with suppress(OSError):
            self._connection.send(json.dumps(message).encode())

    def receive(self) -> dict[str, Any] | None:
        """Wait for a message and return it; return None when the other end is closed."""
        data = b""
        with suppress(OSError):
            data = self._connection.recv(_MAX_SIZE)
        return json.loads(data) if data else None

    def end_sending(self) -> None:
        """Let the other end receive None; it may still send."""
        with suppress(OSError):
            self._connection.shutdown(socket.SHUT_WR)

    def close(self) -> None:
        """Close this end."""
        self._connection.close()
