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

    Args:
        port: where the page is.
        keep: unpacks and keeps what comes.

    Attributes:
        received: bytes so far.
        messages: what came, oldest first, if it is kept.
    """

    def __init__(self, port: int, *, keep: bool = False) -> None:
        import viser
        from websockets.sync.client import connect
        from websockets.typing import Subprotocol

        self.received = 0
        self.messages: list[dict[str, Any]] = []
        self._keep = keep
        self._socket = connect(
            f"ws://127.0.0.1:{port}",
            subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
            max_size=None,
            compression=None,
        )
        self.send(_CAMERA)
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def send(self, message: dict[str, Any]) -> None:
        """Sends what a browser would send."""
        import msgspec.msgpack

        self._socket.send(msgspec.msgpack.encode(message))

    def named(self, kind: str, ending: str) -> list[dict[str, Any]]:
        """The messages of a kind to what has a name with this ending."""
        return [
            message
            for message in list(self.messages)
            if message["type"] == kind and message["name"].endswith(ending)
        ]

    def close(self) -> None:
        """Goes away."""
        self._socket.close()
        self._thread.join()

    def _read(self) -> None:
        for data in self._socket:
            self.received += len(data)
            if self._keep:
                self.messages += unpacked(data)


def unpacked(data: bytes) -> list[dict[str, Any]]:
    """The messages of a packet: two lengths, then zstd-packed msgpack, then arrays (left out)."""
    import msgspec.msgpack
    import zstandard

    size, packed = (int.from_bytes(data[at : at + 8], "little") for at in (0, 8))
    text = zstandard.ZstdDecompressor().decompress(data[16 : 16 + packed], max_output_size=size)
    messages: list[dict[str, Any]] = msgspec.msgpack.decode(text)["messages"]
    return messages
