"""Pictures in the encodings of sensor_msgs/Image, made without the code under test."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np


class RawImage(NamedTuple):
    """The fields of an image message."""

    encoding: str
    width: int
    height: int
    step: int
    data: bytes
    is_bigendian: bool = False


def _channels(order: str, kind: str) -> Callable[[np.ndarray], np.ndarray]:
    def encode(bgr: np.ndarray) -> np.ndarray:
        planes = {"b": bgr[..., 0], "g": bgr[..., 1], "r": bgr[..., 2]}
        planes["a"] = np.full(bgr.shape[:2], 255, np.uint8)
        pixels = np.dstack([planes[letter] for letter in order])
        return pixels if kind == "u1" else pixels.astype(np.uint16) * 257

    return encode


def _grey(kind: str) -> Callable[[np.ndarray], np.ndarray]:
    def encode(bgr: np.ndarray) -> np.ndarray:
        grey = (bgr @ np.array([0.114, 0.587, 0.299])).round().astype(np.uint8)
        return grey if kind == "u1" else grey.astype(np.uint16) * 257

    return encode


def _bayer(pattern: str, kind: str) -> Callable[[np.ndarray], np.ndarray]:
    def encode(bgr: np.ndarray) -> np.ndarray:
        mosaic = np.zeros(bgr.shape[:2], np.uint8)
        for i, letter in enumerate(pattern):
            row, column = divmod(i, 2)
            mosaic[row::2, column::2] = bgr[row::2, column::2, "bgr".index(letter)]
        return mosaic if kind == "u1" else mosaic.astype(np.uint16) * 257

    return encode


def _yuv422(order: str) -> Callable[[np.ndarray], np.ndarray]:
    """ITU-R BT.601 with the studio's range, colours shared by two neighbours."""

    def encode(bgr: np.ndarray) -> np.ndarray:
        b, g, r = (bgr[..., i].astype(float) for i in range(3))
        y = 16 + 0.257 * r + 0.504 * g + 0.098 * b
        u = 128 - 0.148 * r - 0.291 * g + 0.439 * b
        v = 128 + 0.439 * r - 0.368 * g - 0.071 * b
        numbers = np.zeros((*bgr.shape[:2], 2))
        luma = order.index("y")
        numbers[..., luma] = y
        numbers[:, 0::2, 1 - luma] = (u[:, 0::2] + u[:, 1::2]) / 2
        numbers[:, 1::2, 1 - luma] = (v[:, 0::2] + v[:, 1::2]) / 2
        return numbers.round().clip(0, 255).astype(np.uint8)

    return encode


ENCODERS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    **{
        f"{order}{bits}": _channels(order, kind)
        for bits, kind in ((8, "u1"), (16, "u2"))
        for order in ("rgb", "bgr", "rgba", "bgra")
    },
    "mono8": _grey("u1"),
    "mono16": _grey("u2"),
    "8UC1": _grey("u1"),
    "8UC3": _channels("bgr", "u1"),
    "8UC4": _channels("bgra", "u1"),
    "16UC1": _grey("u2"),
    "16UC3": _channels("bgr", "u2"),
    **{
        f"bayer_{pattern}{bits}": _bayer(pattern, kind)
        for bits, kind in ((8, "u1"), (16, "u2"))
        for pattern in ("rggb", "bggr", "gbrg", "grbg")
    },
    "yuv422": _yuv422("uyvy"),
    "uyvy": _yuv422("uyvy"),
    "yuv422_yuy2": _yuv422("yuyv"),
    "yuyv": _yuv422("yuyv"),
}
"""From blue, green, red, shape (height, width, 3), to the numbers of an encoding."""

COLOURLESS = {"mono8", "mono16", "8UC1", "16UC1"}


def raw(
    encoding: str, numbers: np.ndarray, *, big_endian: bool = False, padding: int = 0
) -> RawImage:
    """An image message's fields, with bytes of rubbish after each row."""
    height, width = numbers.shape[:2]
    ordered = numbers.astype(numbers.dtype.newbyteorder(">" if big_endian else "<"))
    rows = np.frombuffer(ordered.tobytes(), np.uint8).reshape(height, -1)
    padded = np.hstack((rows, np.full((height, padding), 0xA5, np.uint8)))
    return RawImage(encoding, width, height, padded.shape[1], padded.tobytes(), big_endian)
