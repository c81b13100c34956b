"""Decode the data of sensor_msgs/Image and CompressedImage: colours and depths."""

from __future__ import annotations

import sys
from functools import cached_property
from typing import Any, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from head_tracking.exceptions import HeadTrackingError
from head_tracking.vision.camera import Box
from head_tracking.vision.opencv import cv2

Pixels: TypeAlias = npt.NDArray[np.uint8]


class ImageError(HeadTrackingError, ValueError):
    """An image cannot be used."""


class RawImage(Protocol):
    """An encoded image, with the fields of sensor_msgs/Image.

    Attributes:
        encoding: name in sensor_msgs/image_encodings.
        width: [pixels].
        height: [pixels].
        step: bytes from one row to the next.
        data: an object with the buffer protocol, at least height * step bytes.
        is_bigendian: byte order of numbers with several bytes.
    """

    encoding: str
    width: int
    height: int
    step: int
    data: Any
    is_bigendian: int


def rows_of(image: RawImage, kind: str, channels: int) -> npt.NDArray[Any]:
    """Return the numbers of an image, shape (height, width, channels), in native byte order.

    Args:
        image: the image.
        kind: NumPy's name of their type.
        channels: numbers of each pixel.

    Raises:
        ImageError: the image is empty, or there are too few bytes.
    """
    dtype = np.dtype(kind)
    width, height, step = image.width, image.height, image.step
    row = width * channels * dtype.itemsize
    data = np.frombuffer(image.data, np.uint8)
    if width < 1 or height < 1:
        raise ImageError(f"the image is empty: {width}x{height} pixels")
    if step < row or data.size < step * (height - 1) + row:
        raise ImageError(
            f"the image of {width}x{height} {image.encoding} pixels is damaged: step {step} "
            f"(at least {row}) and {data.size} bytes (at least "
            f"{max(step, row) * (height - 1) + row})"
        )
    strided = np.lib.stride_tricks.as_strided(data, (height, row), (step, 1), writeable=False)
    numbers = np.ascontiguousarray(strided).view(dtype)
    if dtype.itemsize > 1 and bool(image.is_bigendian) != (sys.byteorder == "big"):
        numbers = numbers.byteswap()
    return numbers.reshape(height, width, channels)


class Picture:
    """An image in the colour spaces of detectors, converted on demand.

    Args:
        bgr: blue, green, red; shape (height, width, 3).
    """

    def __init__(self, bgr: Pixels) -> None:
        self.bgr = bgr

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.bgr.shape[1], self.bgr.shape[0]

    @cached_property
    def gray(self) -> Pixels:
        """Brightness, shape (height, width)."""
        return np.asarray(cv2.cvtColor(self.bgr, cv2.COLOR_BGR2GRAY))

    @cached_property
    def hsv(self) -> Pixels:
        """Hue (0 to 179, two degrees each), saturation and value, shape (height, width, 3)."""
        return np.asarray(cv2.cvtColor(self.bgr, cv2.COLOR_BGR2HSV))


class DepthImage:
    """Depths along the optical axis.

    Args:
        numbers: integers [mm] or floats [m], shape (height, width); 0, negative and not finite
            values mean unknown.
    """

    def __init__(self, numbers: npt.NDArray[Any]) -> None:
        self._numbers = numbers
        self._unit = 1.0 if numbers.dtype.kind == "f" else 1e-3

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self._numbers.shape[1], self._numbers.shape[0]

    def metres(
        self, rows: slice = slice(None), columns: slice = slice(None)
    ) -> npt.NDArray[np.float32]:
        """Return the depths of a part [m]; NaN: unknown."""
        part = self._numbers[rows, columns].astype(np.float32)
        if self._unit != 1.0:
            part *= self._unit
        part[~(np.isfinite(part) & (part > 0.0))] = np.nan
        return part

    def part(self, box: Box) -> npt.NDArray[np.float32]:
        """Return the depths in a box [m]; empty outside the image."""
        return self.metres(*box.clipped(*self.size).slices())


def decode_picture(image: RawImage) -> Picture:
    """Decode an image in colour or grey.

    Raises:
        ImageError: the encoding is not supported, or the data does not match it.
    """
    try:
        kind, channels, conversion = _ENCODINGS[image.encoding.lower()]
    except KeyError:
        raise ImageError(
            f"the image encoding {image.encoding!r} is not supported; supported are "
            f"{', '.join(sorted(_ENCODINGS))}"
        ) from None
    pixels = rows_of(image, kind, channels)
    width, height = image.width, image.height
    if conversion.startswith("Bayer") and min(width, height) < 2:
        raise ImageError(f"the Bayer image has {width}x{height} pixels; the minimum is 2x2")
    if conversion.startswith("YUV") and width % 2:
        raise ImageError(f"the encoding {image.encoding} needs an even width; it is {width}")
    if kind == "u2":
        pixels = (pixels >> 8).astype(np.uint8)
    if conversion:
        pixels = np.asarray(cv2.cvtColor(pixels, getattr(cv2, f"COLOR_{conversion}")))
    return Picture(pixels)


def decode_depth(image: RawImage) -> DepthImage:
    """Decode a depth image: 16UC1 or mono16 [mm], or 32FC1 [m].

    Raises:
        ImageError: the encoding is not supported, or the data does not match it.
    """
    kind = {"16uc1": "u2", "mono16": "u2", "32fc1": "f4"}.get(image.encoding.lower())
    if kind is None:
        raise ImageError(
            f"the depth encoding {image.encoding!r} is not supported; supported are 16UC1 "
            "(millimetres) and 32FC1 (metres)"
        )
    return DepthImage(rows_of(image, kind, 1)[..., 0])


def decode_compressed_picture(data: Any, described: str) -> Picture:
    """Decode a sensor_msgs/CompressedImage.

    Args:
        data: JPEG, PNG or another format of OpenCV; an object with the buffer protocol.
        described: `format` of the message.

    Raises:
        ImageError: OpenCV cannot decode it.
    """
    return Picture(_decompressed(data, described, cv2.IMREAD_COLOR))


def decode_compressed_depth(data: Any, described: str) -> DepthImage:
    """Decode a CompressedImage of the image transport `compressedDepth`.

    Twelve bytes (an unused number and two floats a and b) precede a PNG with 16 bits. It contains
    millimetres for 16UC1, and a / depth + b (0: unknown) for 32FC1 (source:
    compressed_depth_image_transport).

    Args:
        data: an object with the buffer protocol.
        described: `format` of the message, such as "16UC1; compressedDepth png".

    Raises:
        ImageError: the compression is not supported, or the data is damaged.
    """
    encoding, _, how = (part.strip().lower() for part in described.partition(";"))
    if encoding not in ("16uc1", "mono16", "32fc1") or how not in (
        "compresseddepth", "compresseddepth png",
    ):  # fmt: skip
        raise ImageError(
            f"the format {described!r} of a compressed depth image is not supported; supported are "
            "'16UC1; compressedDepth png' and '32FC1; compressedDepth png'"
        )
    numbers = _decompressed(np.frombuffer(data, np.uint8)[12:], described, cv2.IMREAD_UNCHANGED)
    if numbers.dtype != np.uint16 or numbers.ndim != 2:
        raise ImageError(
            f"the compressed depth image {described!r} is damaged: its PNG has {numbers.dtype} "
            f"numbers of shape {numbers.shape}, not 16 bits a pixel"
        )
    if encoding != "32fc1":
        return DepthImage(numbers)
    a, b = np.frombuffer(data, "<f4", 2, 4).tolist()
    with np.errstate(divide="ignore", invalid="ignore"):
        depths = np.float32(a) / (numbers.astype(np.float32) - np.float32(b))
    depths[numbers == 0] = np.nan
    return DepthImage(depths)


def _decompressed(data: Any, described: str, flags: int) -> npt.NDArray[Any]:
    coded = np.frombuffer(data, np.uint8)
    try:
        decoded = cv2.imdecode(coded, flags) if coded.size else None
    except cv2.error as error:
        raise ImageError(f"the compressed image {described!r} is damaged: {error}") from error
    if decoded is None:
        raise ImageError(
            f"the compressed image {described!r} of {coded.size} bytes is damaged, or OpenCV does "
            "not support its compression"
        )
    return np.asarray(decoded)


_ENCODINGS: dict[str, tuple[str, int, str]] = {
    name: (kind, channels, conversion)
    for bits, kind in (("8", "u1"), ("16", "u2"))
    for name, channels, conversion in (
        (f"bgr{bits}", 3, ""),
        (f"rgb{bits}", 3, "RGB2BGR"),
        (f"bgra{bits}", 4, "BGRA2BGR"),
        (f"rgba{bits}", 4, "RGBA2BGR"),
        (f"mono{bits}", 1, "GRAY2BGR"),
        # OpenCV names a pattern by its second row: rggb is BayerBG
        (f"bayer_rggb{bits}", 1, "BayerBG2BGR"),
        (f"bayer_bggr{bits}", 1, "BayerRG2BGR"),
        (f"bayer_gbrg{bits}", 1, "BayerGR2BGR"),
        (f"bayer_grbg{bits}", 1, "BayerGB2BGR"),
        (f"{bits}uc1", 1, "GRAY2BGR"),
        (f"{bits}uc3", 3, ""),
        (f"{bits}uc4", 4, "BGRA2BGR"),
    )
} | {
    "yuv422": ("u1", 2, "YUV2BGR_UYVY"),
    "uyvy": ("u1", 2, "YUV2BGR_UYVY"),
    "yuv422_yuy2": ("u1", 2, "YUV2BGR_YUY2"),
    "yuyv": ("u1", 2, "YUV2BGR_YUY2"),
}
"""Type and number of the channels of each encoding, and OpenCV's conversion; empty: none."""
