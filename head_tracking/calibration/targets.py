"""What a calibration looks at: a marker, a still face, or the room."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeAlias

import numpy as np

from head_tracking.calibration.geometry import Array
from head_tracking.calibration.solver import CalibrationError, Reason
from head_tracking.parameters import ParameterError, verified
from head_tracking.vision.candidate import Frame, ellipse_mask
from head_tracking.vision.faces import FaceDetector, FaceParameters
from head_tracking.vision.images import Pixels
from head_tracking.vision.markers import (
    MarkerDetector,
    MarkerParameters,
    marker_family,
)
from head_tracking.vision.opencv import cv2

TARGETS: Final = {"marker": 1.0, "face": 4.0, "room": 2.0}
"""By name: maximum motion between two images of a still one [px]; the middle of a marker is located
best."""

SMALLEST_MARKER: Final = 0.005
LARGEST_MARKER: Final = 2.0
"""Allowed edges of a marker [m]; larger numbers are millimetres."""

Observe: TypeAlias = Callable[[Frame], dict[int, Array]]
"""Returns the visible markers or points by their number: corners (4, 2), or a point (1, 2) [px]."""

_VIEW: Final = 64  # pixels: width of an image of a face
_CORNERS: Final = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
_VIEWED: Final = ((_CORNERS + 1.0) * (0.5 * (_VIEW - 1))).astype(np.float32)
_INSIDE: Final = ellipse_mask(_VIEW, _VIEW, 0.85).astype(np.uint8)
_SMOOTHED: Final = 5  # pixels
_CELLS: Final = 6, 4  # of the first image: at most one point of the room in each
_KEYPOINTS: Final = 1500
_PARALLAX: Final = 0.025  # of the image width: points at different distances move differently
_FEWEST: Final = 20  # matches of the first image


def observer(target: str, marker: MarkerParameters | None) -> Observe:
    """Return the function that finds a target in images.

    Args:
        target: one of `TARGETS`.
        marker: family, number and size of the marker.

    Raises:
        ParameterError: there is no such target or marker, or the marker has no size.
    """
    if target not in TARGETS:
        raise ParameterError(f"the target is {target!r}; allowed are {', '.join(TARGETS)}")
    if target == "face":
        return _FaceView()
    if target == "room":
        return _Room()
    marker = verified(marker or MarkerParameters())
    if not SMALLEST_MARKER <= marker.marker_size <= LARGEST_MARKER:
        raise ParameterError(
            f"marker_size is {marker.marker_size}; set it to the edge of the black square, "
            f"{SMALLEST_MARKER:g} to {LARGEST_MARKER:g} m"
        )
    if marker.marker_id >= (count := len(marker_family(marker.dictionary).bytesList)):
        raise ParameterError(
            f"marker_id is {marker.marker_id}; {marker.dictionary} has the numbers 0 to {count - 1}"
        )
    return _Markers(marker)


def what_to_show(target: str, marker: MarkerParameters | None) -> str:
    """Return what must be visible, for the case that it is not."""
    if target == "room":
        return "a part of the room with texture"
    if target == "face" or marker is None:
        return "a face, with the camera upright"
    number = "of any number" if marker.marker_id < 0 else f"with the number {marker.marker_id}"
    return f"a marker {number} of the family {marker.dictionary}"


class _Markers:
    """Finds markers that differ in their numbers.

    Args:
        marker: family, number and size.
    """

    def __init__(self, marker: MarkerParameters) -> None:
        self._detector = MarkerDetector(marker)

    def __call__(self, frame: Frame) -> dict[int, Array]:
        """Return the corners of each marker, shape (4, 2) [px].

        Raises:
            CalibrationError: two markers have the same number.
        """
        found: dict[int, Array] = {}
        for each in self._detector.detect(frame, []):
            number, corners = int(each.label), np.asarray(each.points, float)
            before = found.get(number, corners)
            # a marker may be detected twice, by its outline and by its border
            if np.linalg.norm(np.mean(corners - before, axis=0)) > 0.5 * each.box.width:
                raise CalibrationError(
                    Reason.TWO_MARKERS,
                    f"an image has two markers with the number {number}: remove or cover one of "
                    "them, or print it with another number",
                )
            found[number] = corners
        return found


class _FaceView:
    """Finds the same point of the largest face in each image.

    The middle of a detected box varies by 2 to 4 % of its width, and a wide lens stretches a face
    at the edge of the image outwards. So a virtual camera looks at each face, and its image is
    aligned with the first one (ECC: Evangelidis and Psarakis, 2008).
    """

    def __init__(self) -> None:
        self._detector = FaceDetector(FaceParameters(search_period=1))
        self._first: Pixels | None = None
        self._half = 0.0  # of the width of the virtual images, at z = 1

    def __call__(self, frame: Frame) -> dict[int, Array]:
        assert frame.picture is not None
        faces = self._detector.detect(frame, [])
        if not faces:
            return {}
        face, camera = max(faces, key=lambda face: face.box.width), frame.camera
        self._half = self._half or 0.5 * face.box.width / camera.focal_length()
        axes = _axes_towards(camera.ray(face.centre))
        corners = [camera.pixel((axes @ (x, y, 1.0)).tolist()) for x, y in self._half * _CORNERS]
        if None in corners:
            return {}
        to_image = cv2.getPerspectiveTransform(_VIEWED, np.array(corners, np.float32))
        view = cv2.warpPerspective(
            frame.picture.gray,
            to_image,
            (_VIEW, _VIEW),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        if self._first is None:
            self._first = view
        aligned = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-4)
        try:
            _, moved = cv2.findTransformECC(
                self._first, view, np.eye(2, 3, dtype=np.float32), cv2.MOTION_EUCLIDEAN, aligned,
                _INSIDE, _SMOOTHED,
            )  # fmt: skip
        except cv2.error:  # they are not alike
            return {}
        middle = moved @ (*_VIEWED.mean(axis=0), 1.0)
        return {0: np.asarray(cv2.perspectiveTransform(middle[None, None], to_image)[0], float)}


def _axes_towards(ray: tuple[float, float]) -> Array:
    """Return the axes of a camera that looks along a ray, in columns."""
    ahead = np.array((*ray, 1.0))
    right = np.cross((0.0, 1.0, 0.0), ahead)
    axes = np.stack([right, np.cross(ahead, right), ahead], axis=1)
    return np.asarray(axes / np.linalg.norm(axes, axis=0))


class _Room:
    """Finds the distinct points of the first image in later images (ORB: Rublee, 2011).

    All points of the first image are matched, because a few fit a wrong homography by chance; those
    that are spread over the image are returned.
    """

    def __init__(self) -> None:
        self._orb = cv2.ORB_create(_KEYPOINTS)
        self._matcher = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True)
        self._first: tuple[Array, Pixels] | None = None
        self._chosen: list[int] = []

    def __call__(self, frame: Frame) -> dict[int, Array]:
        assert frame.picture is not None
        keypoints, descriptors = self._orb.detectAndCompute(frame.picture.gray, None)
        if descriptors is None:
            return {}
        points = np.array([keypoint.pt for keypoint in keypoints])
        if self._first is None:
            responses = np.array([keypoint.response for keypoint in keypoints])
            self._first = points, descriptors
            self._chosen = _spread(points, responses, frame.picture.size)
        first, known = self._first
        pairs = np.array(
            [(match.queryIdx, match.trainIdx) for match in self._matcher.match(known, descriptors)]
        ).reshape(-1, 2)
        if len(pairs) < _FEWEST:
            return {}
        limit = _PARALLAX * frame.camera.width
        _, agree = cv2.findHomography(first[pairs[:, 0]], points[pairs[:, 1]], cv2.RANSAC, limit)
        if agree is None or agree.sum() < _FEWEST:
            return {}
        found = dict(pairs[agree.ravel() > 0].tolist())
        return {k: points[[found[k]]] for k in self._chosen if k in found}


def _spread(points: Array, responses: Array, size: tuple[int, int]) -> list[int]:
    """Return the index of the strongest point in each cell of an image."""
    cells = (points / size * _CELLS).astype(int) @ (1, _CELLS[0])
    best: dict[int, int] = {}
    for index in np.argsort(-responses).tolist():
        best.setdefault(int(cells[index]), index)
    return list(best.values())
