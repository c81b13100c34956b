"""A client of the page that reads everything and draws nothing."""

from __future__ import annotations

import contextlib
import json
import threading
from typing import Any

from waiting import join


class ReadingClient:
    """Costs the page's process what a browser costs it, and this machine next to nothing.

    Args:
        port: where the page is.
        keep: keeps the messages.

    Attributes:
        received: bytes so far.
        messages: what came, oldest first, if it is kept.
    """

    def __init__(self, port: int, *, keep: bool = False) -> None:
        from websockets.exceptions import ConnectionClosed
        from websockets.sync.client import connect

        self.received = 0
        self.messages: list[dict[str, Any]] = []
        self._keep, self._closed = keep, ConnectionClosed
        self._socket = connect(f"ws://127.0.0.1:{port}/head/live", max_size=None)
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def named(self, kind: str) -> list[dict[str, Any]]:
        """Return the messages of a kind."""
        return [message for message in list(self.messages) if message.get("type") == kind]

    def close(self) -> None:
        """Go away."""
        self._socket.close()
        join(self._thread)

    def _read(self) -> None:
        for data in self._socket:
            self.received += len(data)
            if isinstance(data, bytes):
                with contextlib.suppress(self._closed):
                    self._socket.send("got")
            elif self._keep:
                self.messages.append(json.loads(data))
