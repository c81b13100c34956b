"""A client of the viewer's page that reads everything and draws nothing."""

from __future__ import annotations

import threading
from typing import Any

_CAMERA: dict[str, Any] = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (1.0, 1.0, 1.0),
    "fov": 1.0,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 600,
    "image_width": 800,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}


class ReadingClient:
    """Costs the viewer what a browser costs it, and this machine next to nothing.

    Attributes:
        received: bytes so far.
    """

    def __init__(self, port: int) -> None:
        import msgspec.msgpack
        import viser
        from websockets.sync.client import connect
        from websockets.typing import Subprotocol

        self.received = 0
        self._socket = connect(
            f"ws://127.0.0.1:{port}",
            subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
            max_size=None,
            compression=None,
        )
        self._socket.send(msgspec.msgpack.encode(_CAMERA))
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def close(self) -> None:
        """Goes away."""
        self._socket.close()
        self._thread.join()

    def _read(self) -> None:
        for data in self._socket:
            self.received += len(data)
