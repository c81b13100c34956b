"""Camera model of CameraInfo: conversion between pixels and rays in the optical frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from head_tracking.exceptions import HeadTrackingError
from head_tracking.transforms import Vector3
from head_tracking.vision.opencv import cv2


class CameraError(HeadTrackingError, ValueError):
    """The calibration of a camera cannot be used."""


class Box(NamedTuple):
    """A rectangle in an image, in (fractional) pixels."""

    x: float
    y: float
    width: float
    height: float

    @property
    def centre(self) -> tuple[float, float]:
        """Column and row of the middle."""
        return self.x + self.width / 2, self.y + self.height / 2

    def clipped(self, width: int, height: int) -> Box:
        """Return the part inside an image; width or height is 0 if there is none."""
        left, top = min(max(self.x, 0.0), width), min(max(self.y, 0.0), height)
        right = min(max(self.x + self.width, left), width)
        bottom = min(max(self.y + self.height, top), height)
        return Box(left, top, right - left, bottom - top)

    def grown(self, factor: float) -> Box:
        """Return a scaled box with the same middle."""
        x, y = self.centre
        width, height = self.width * factor, self.height * factor
        return Box(x - width / 2, y - height / 2, width, height)

    def slices(self) -> tuple[slice, slice]:
        """Return the rows and columns of the pixels inside."""
        return (
            slice(math.floor(self.y), math.ceil(self.y + self.height)),
            slice(math.floor(self.x), math.ceil(self.x + self.width)),
        )


_NO_DISTORTION: tuple[float, ...] = ()
_MODELS = {
    "": (4, 5, 8),
    "plumb_bob": (4, 5),
    "rational_polynomial": (8, 12, 14),
    "equidistant": (4,),
}
"""Allowed numbers of coefficients of each distortion model."""
_UNTURNED = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole camera; its optical frame looks along z, with x to the right and y down.

    Attributes:
        width: width of the images [pixels].
        height: height of the images [pixels].
        fx: horizontal focal length [pixels].
        fy: vertical focal length [pixels].
        cx: column of the optical axis; the middle of the leftmost pixel is 0.
        cy: row of the optical axis.
        distortion: coefficients as in CameraInfo; empty: none.
        fisheye: whether the distortion model is `equidistant`.
        turn: R of CameraInfo, row-major: rotation from the axes of the lens to the optical frame of
            rectified images.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = _NO_DISTORTION
    fisheye: bool = False
    turn: tuple[float, ...] = _UNTURNED

    @staticmethod
    def from_calibration(
        size: tuple[int, int],
        k: Sequence[float],
        distortion: Sequence[float] = (),
        model: str = "plumb_bob",
        *,
        turn: Sequence[float] = (),
        projection: Sequence[float] = (),
        rectified: bool = False,
        binning: tuple[int, int] = (1, 1),
        region: tuple[int, int, int, int] = (0, 0, 0, 0),
    ) -> Camera:
        """Return the camera that a CameraInfo message describes.

        Args:
            size: width and height of the full image [pixels].
            k: intrinsic matrix K, shape (9,), row-major.
            distortion: coefficients D.
            model: name of the distortion model.
            turn: rotation matrix R, shape (9,), row-major; empty or all 0: identity.
            projection: projection matrix P, shape (12,), row-major.
            rectified: whether the images are rectified: use P instead of K, D and R.
            binning: binning in x and y; 0 is the same as 1.
            region: x, y, width and height of the region of interest; all 0: the full image.

        Raises:
            CameraError: the values are invalid, such as the zeros of an uncalibrated camera.
        """
        if rectified:
            if len(projection) != 12:
                raise CameraError(
                    f"the matrix P is {list(projection)}; it needs twelve finite numbers"
                )
            k = [*projection[0:3], *projection[4:7], *projection[8:11]]
            distortion, turn = (), ()
        turn = tuple(turn) if any(turn) else _UNTURNED
        if len(k) != 9 or not all(map(math.isfinite, k)):
            raise CameraError(
                f"the matrix {'P' if rectified else 'K'} is {list(k)}; it needs nine finite numbers"
            )
        is_bounded = len(turn) == 9 and max(map(abs, turn)) < 2.0
        if not (is_bounded and np.abs(_rows(turn) @ _rows(turn).T - np.eye(3)).max() < 1e-3):
            raise CameraError(f"the matrix R is {list(turn)}; it must be a rotation")
        fx, fy, cx, cy = k[0], k[4], k[2], k[5]
        if min(*size, fx, fy) <= 0:
            raise CameraError(
                f"the camera is not calibrated: its CameraInfo has size {size[0]}x{size[1]} and "
                f"focal lengths {fx:g} and {fy:g}, which must be above 0"
            )
        if not all(map(math.isfinite, distortion)):
            raise CameraError(f"the coefficients D are {list(distortion)}; they must be finite")
        if any(distortion) and len(distortion) not in _MODELS.get(model, ()):
            raise CameraError(
                f"the distortion model {model!r} with {len(distortion)} coefficients is unknown; "
                "use plumb_bob (4 or 5), rational_polynomial (8, 12 or 14), equidistant (4), or "
                "rectified images"
            )
        x, y, width, height = region if region[2] and region[3] else (0, 0, *size)
        across, down = max(1, binning[0]), max(1, binning[1])
        return Camera(
            width // across,
            height // down,
            fx / across,
            fy / down,
            (cx - x) / across,
            (cy - y) / down,
            tuple(distortion) if any(distortion) else _NO_DISTORTION,
            any(distortion) and model == "equidistant",
            turn,
        )

    def ray(self, pixel: tuple[float, float]) -> tuple[float, float]:
        """Return the ray of a pixel (column, row): x and y at z = 1 in the optical frame."""
        if self._is_plain:
            return (pixel[0] - self.cx) / self.fx, (pixel[1] - self.cy) / self.fy
        points = np.array([[pixel]], np.float64)
        lens = self.matrix, np.array(self.distortion or [0.0] * 4), _rows(self.turn)
        if self.fisheye:
            found = cv2.fisheye.undistortPoints(points, *lens)
        else:
            enough = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-8)
            found = cv2.undistortPointsIter(points, *lens, np.eye(3), enough)
        x, y = found.reshape(2).tolist()
        return x, y

    @property
    def _is_plain(self) -> bool:
        return not self.distortion and self.turn == _UNTURNED

    def point(self, pixel: tuple[float, float], depth: float) -> Vector3:
        """Return the point [m] of a pixel in the optical frame.

        Args:
            pixel: column and row.
            depth: z of the point [m], as in a depth image.
        """
        x, y = self.ray(pixel)
        return x * depth, y * depth, depth

    def pixel(self, point: Sequence[float]) -> tuple[float, float] | None:
        """Return column and row of a point [m] in the optical frame.

        None for a point behind the camera, and for one outside the valid range of the distortion
        polynomial, which is not monotonic far outside the image.
        """
        x, y, z = point
        if z <= 0:
            return None
        if self._is_plain:
            return self.fx * x / z + self.cx, self.fy * y / z + self.cy
        if _rows(self.turn)[:, 2] @ (x, y, z) <= 0.0:  # behind the lens
            return None
        project = cv2.fisheye.projectPoints if self.fisheye else cv2.projectPoints
        turn, _ = cv2.Rodrigues(_rows(self.turn).T)
        points, lens = np.array([[[x / z, y / z, 1.0]]]), np.array(self.distortion or [0.0] * 4)
        found, _ = project(points, turn, np.zeros(3), self.matrix, lens)
        u, v = found.reshape(2).tolist()
        return (u, v) if math.dist(self.ray((u, v)), (x / z, y / z)) < 1e-3 else None

    @property
    def matrix(self) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
        """Intrinsic matrix, shape (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def focal_length(self) -> float:
        """Return the mean of fx and fy [pixels]."""
        return (self.fx + self.fy) / 2


def _rows(turn: Sequence[float]) -> npt.NDArray[np.float64]:
    return np.reshape(turn, (3, 3))


def camera_with_view(width: int, height: int, horizontal_view: float) -> Camera:
    """Return a camera without distortion.

    Args:
        width: width of the images [pixels].
        height: height of the images [pixels].
        horizontal_view: horizontal field of view [rad].

    Raises:
        CameraError: the field of view is not possible.
    """
    if not 0.0 < horizontal_view < math.pi:
        raise CameraError(
            f"the horizontal field of view is {horizontal_view} rad; allowed are 0 to pi: convert "
            "degrees with math.radians"
        )
    focal = width / 2 / math.tan(horizontal_view / 2)
    return Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
