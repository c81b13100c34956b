"""Detector of ArUco and AprilTag markers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from head_tracking.parameters import parameter
from head_tracking.transforms import Vector3
from head_tracking.vision.camera import Box, Camera
from head_tracking.vision.candidate import Candidate, Detector, Frame
from head_tracking.vision.images import Pixels
from head_tracking.vision.opencv import cv2

DICTIONARIES = (
    *(f"{n}X{n}_{count}" for n in (4, 5, 6, 7) for count in (50, 100, 250, 1000)),
    "ARUCO_ORIGINAL",
    "APRILTAG_16h5",
    "APRILTAG_25h9",
    "APRILTAG_36h10",
    "APRILTAG_36h11",
)
"""Marker families of OpenCV."""


@dataclass(frozen=True, slots=True)
class MarkerParameters:
    """Family, number and size of the markers."""

    dictionary: str = parameter("4X4_50", "Marker family.", choices=DICTIONARIES)
    marker_id: int = parameter(-1, "Number of the marker; -1: any.", minimum=-1, maximum=100_000)
    marker_size: float = parameter(
        0.0,
        "Edge of the black square, to measure the distance without depths; 0: unknown.",
        unit="m",
        minimum=0.0,
        maximum=100.0,
    )


class MarkerDetector(Detector):
    """Detects markers of one family."""

    Parameters = MarkerParameters

    def __init__(self, parameters: MarkerParameters) -> None:
        super().__init__(parameters)
        self._family, self._detector = parameters.dictionary, _detector(parameters.dictionary)

    def detect(self, frame: Frame, hints: Sequence[Box]) -> list[Candidate]:
        """Return all markers with the required number."""
        wanted = self.parameters.marker_id
        return [
            self._candidate(number, corners, frame.camera)
            for number, corners in self._markers(frame)
            if wanted in (-1, number)
        ]

    def _markers(self, frame: Frame) -> list[tuple[int, npt.NDArray[np.float32]]]:
        # minimum size for the adaptive threshold of OpenCV
        if frame.picture is None or min(frame.picture.size) < 16:
            return []
        if self.parameters.dictionary != self._family:
            self._family = self.parameters.dictionary
            self._detector = _detector(self._family)
        corners, numbers, _ = self._detector(frame.picture.gray)
        if numbers is None:
            return []
        found = zip(numbers.ravel().tolist(), corners, strict=True)
        return [(number, quad.reshape(4, 2)) for number, quad in found]

    def _candidate(
        self, number: int, corners: npt.NDArray[np.float32], camera: Camera
    ) -> Candidate:
        x, y, width, height = cv2.boundingRect(corners)
        size = self.parameters.marker_size
        mask = np.zeros((height, width), np.uint8)
        cv2.fillConvexPoly(mask, np.round(corners - [x, y]).astype(np.int32), 1)
        return Candidate(
            Box(x, y, width, height),
            _middle(corners),
            1.0,
            str(number),
            mask=mask > 0,
            position=_position(corners, size, camera) if size else None,
            points=corners,
        )


def marker_family(dictionary: str) -> Any:
    """Return OpenCV's description of a family: the bits of its markers, and their number."""
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{dictionary}"))


def _detector(dictionary: str) -> Callable[[Pixels], Any]:
    """Return a function that detects the markers of a family in a grey image."""
    family = marker_family(dictionary)
    older = not hasattr(cv2.aruco, "ArucoDetector")  # before 4.7, as on Ubuntu 24.04
    settings = cv2.aruco.DetectorParameters_create() if older else cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    if dictionary.startswith("APRILTAG"):
        # tags of 36h11 differ by 11 bits: 5 wrong bits can be corrected; OpenCV 4.6 and 4.11 say 0
        family.maxCorrectionBits = (int(dictionary.rpartition("h")[2]) - 1) // 2
    if older:
        # the default merges the outlines of the marker and of its white border
        settings.minMarkerDistanceRate = 0.03
        return lambda gray: cv2.aruco.detectMarkers(gray, family, parameters=settings)
    find: Callable[[Pixels], Any] = cv2.aruco.ArucoDetector(family, settings).detectMarkers
    return find


def _middle(corners: npt.NDArray[np.float32]) -> tuple[float, float]:
    """Return the intersection of the diagonals: the middle of the square in perspective."""
    a, b, c, d = np.column_stack((corners, np.ones(4)))
    u, v, w = np.cross(np.cross(a, c), np.cross(b, d))
    return float(u / w), float(v / w)


def _position(corners: npt.NDArray[np.float32], size: float, camera: Camera) -> Vector3 | None:
    half = size / 2
    square = np.array(
        [[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]], np.float64
    )
    rays = np.array([camera.ray((float(u), float(v))) for u, v in corners])
    solved, _, shift = cv2.solvePnP(square, rays, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
    if not solved or not np.isfinite(shift).all() or shift[2, 0] <= 0:
        return None
    x, y, z = shift.ravel().tolist()
    return x, y, z
