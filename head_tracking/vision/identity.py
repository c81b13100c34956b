"""One object from image to image: its motion, its colours, and which detections may be its own."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from head_tracking.parameters import parameter
from head_tracking.transforms import Transform, Vector3
from head_tracking.vision.camera import Box
from head_tracking.vision.candidate import Candidate, Frame
from head_tracking.vision.opencv import cv2

Appearance: TypeAlias = npt.NDArray[np.float32]

_BINS = (12, 4, 4)
_DEPTH = 0.35  # m between face and clothes at most; other pixels are background
_ACCELERATION = 2.0  # m/s²: process noise
_CONFIRMED_OF = 5  # images
_FARTHEST = 0.5
"""Maximum distance [m] from the predicted position after a loss. Without this limit the gate would
grow with time, and so the risk of taking over another person."""
_RENAMED = 0.5
"""Maximum cost of a detection with a new id at the position of a track."""
_MOST_DIFFERENT, _MOST_DIFFERENT_AFTER_LOSS = 0.75, 0.5
"""Maximum distance of the appearances of one object; the second value applies after a loss, or away
from the predicted position. For rendered people it is below 0.45 for the same person and above 0.6
for others."""


@dataclass(frozen=True, slots=True)
class IdentityParameters:
    """Confirmation and loss of tracks."""

    confirm_images: int = parameter(
        3,
        "An object is confirmed after detections in so many of five images.",
        minimum=1,
        maximum=_CONFIRMED_OF,
    )
    memory: float = parameter(
        2.0,
        "A lost target is kept for this time.",
        unit="s",
        minimum=0.1,
        maximum=60.0,
    )
    min_confidence: float = parameter(
        0.3, "Minimum confidence of a published target.", minimum=0.0, maximum=1.0
    )


@dataclass(frozen=True, slots=True)
class Located:
    """A detection with its position.

    Attributes:
        candidate: the detection.
        point: position in the optical frame [m].
        depth_known: whether the distance was measured.
        radius: half of the angular width [rad].
        appearance: see `colours_of`; empty without colours.
    """

    candidate: Candidate
    point: Vector3
    depth_known: bool
    radius: float = 0.0
    appearance: Appearance = field(default_factory=lambda: np.zeros(0, np.float32), compare=False)


class Track:
    """One object over time: a Kalman filter with constant velocity in the fixed frame."""

    def __init__(
        self, number: int, located: Located, T_fixed_optical: Transform, now: float
    ) -> None:
        self.number = number
        self.position = np.array(T_fixed_optical @ located.point)
        self.velocity = np.zeros(3)
        self.appearance = located.appearance
        self.label = located.candidate.label
        self.seen = now
        self.now = now
        self.recent = [True]
        self.believed = False
        self.confidence = located.candidate.confidence
        self.latest = located
        self.covariance = np.diag([0.05**2, 0.7**2])

    @property
    def located(self) -> Located | None:
        """Detection in the latest image; None: not detected."""
        return self.latest if self.seen == self.now else None

    def predict(self, now: float) -> None:
        """Predict to the time `now` [s]."""
        # the predicted speed decays after a loss
        lost = self.now - self.seen
        dt, self.now = now - self.now, now
        self.position = self.position + self.velocity * dt * math.exp(-lost)
        advance = np.array([[1.0, dt], [0.0, 1.0]])
        noise = np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]]) * _ACCELERATION**2
        self.covariance = advance @ self.covariance @ advance.T + noise

    def cost(self, located: Located, T_optical_fixed: Transform) -> float:
        """Return the cost of assigning a detection to this track; infinite: another object."""
        difference = self._difference(located, T_optical_fixed)
        if located.candidate.label == self.label:  # an id is followed everywhere: at most 1
            return -math.expm1(-difference) if located.candidate.unique else difference
        # the next image may have another id for the same object
        is_renamed = located.candidate.unique and self.recent[-1] and difference < _RENAMED
        return 2.0 + difference if is_renamed else math.inf

    def _difference(self, located: Located, T_optical_fixed: Transform) -> float:
        expected = T_optical_fixed @ self.position.tolist()
        away, distance = math.hypot(*expected), math.hypot(*located.point)
        if away < 1e-6 or distance < 1e-6:
            return math.inf
        cosine = sum(a * b for a, b in zip(expected, located.point, strict=True)) / away / distance
        angle = math.acos(max(-1.0, min(1.0, cosine)))
        unknown = min(_FARTHEST, 3.0 * math.sqrt(self.covariance[0, 0]))
        reach = 0.03 + located.radius + unknown / away
        ratio = abs(math.log(distance / away))
        measured = located.depth_known and self.latest.depth_known
        if measured and abs(distance - away) > unknown + 0.1 * away:
            return math.inf
        lost, here = not self.recent[-1], angle <= 0.03 + located.radius
        if angle > reach or ratio > 0.7 or (lost and angle * away > _FARTHEST):
            return math.inf
        colours = appearance_distance(self.appearance, located.appearance)
        if colours > (_MOST_DIFFERENT if here and not lost else _MOST_DIFFERENT_AFTER_LOSS):
            return math.inf
        return angle / reach + 2.0 * ratio + 3.0 * colours

    def update(self, located: Located, T_fixed_optical: Transform, *, learn: bool) -> None:
        """Correct by a detection; learn: whether to learn its appearance, too."""
        spread = (0.01 if located.depth_known else 0.03) * math.hypot(*located.point)
        gain = self.covariance[:, 0] / (self.covariance[0, 0] + spread**2)
        change = np.array(T_fixed_optical @ located.point) - self.position
        self.position = self.position + gain[0] * change
        self.velocity = self.velocity + gain[1] * change
        self.covariance = self.covariance - np.outer(gain, self.covariance[0])
        self.seen, self.latest, self.label = self.now, located, located.candidate.label
        self.confidence += 0.3 * (located.candidate.confidence - self.confidence)
        if learn and located.appearance.shape == self.appearance.shape:
            self.appearance = 0.95 * self.appearance + 0.05 * located.appearance
        self._remember(True)

    def missed(self) -> None:
        """Record a missing detection."""
        self.confidence *= 0.8
        self._remember(False)

    def _remember(self, found: bool) -> None:
        self.recent = [*self.recent[-_CONFIRMED_OF + 1 :], found]


def is_possible(point: Vector3) -> bool:
    """Return whether something can be at a point [m]: not at the camera, and at most 1000 km away.

    With the numbers of a damaged message the filter would overflow.
    """
    return 1e-6 <= math.hypot(*point) <= 1e6  # False for NaN


def colours_of(frame: Frame, candidate: Candidate, depth: float | None = None) -> Appearance:
    """Return colour histograms of an object and of the region below it (clothes).

    Args:
        frame: the image, with colours.
        candidate: the object.
        depth: depth of the object [m], to exclude the background; None: unknown.

    Returns:
        Histograms of hue, saturation and value, shape (2, 192): object, region below. The sum of a
        row is 1, or 0 if that region is not visible.
    """
    box = candidate.box
    below = Box(box.x, box.y + box.height, box.width, 0.35 * box.height)
    rows = [
        _histogram(frame, box, depth, candidate),
        # a mask covers the whole object
        _histogram(frame, below, depth) if candidate.mask is None else _NOTHING,
    ]
    return np.stack(rows)


def appearance_distance(a: Appearance, b: Appearance) -> float:
    """Return the larger Hellinger distance of the two histograms.

    Returns:
        0 (equal, or not comparable) to 1 (no common colour).
    """
    if not a.size or a.shape != b.shape:
        return 0.0
    a, b = np.atleast_2d(a), np.atleast_2d(b)
    both = (a.sum(axis=1) > 0.0) & (b.sum(axis=1) > 0.0)
    if not both.any():
        return 0.0
    common = np.sqrt(a[both] * b[both]).sum(axis=1).min()
    return math.sqrt(max(0.0, 1.0 - float(common)))


_NOTHING = np.zeros(math.prod(_BINS), np.float32)


def _histogram(
    frame: Frame, box: Box, depth: float | None, candidate: Candidate | None = None
) -> Appearance:
    """Return the colour histogram of a box, or of the candidate in it, shape (192,).

    It is 0 if the box is not visible.
    """
    assert frame.picture is not None
    part = frame.picture.hsv[box.clipped(*frame.picture.size).slices()]
    shape = part.shape[:2]
    if not part.size:
        return _NOTHING
    mask = np.ones(shape, np.bool_) if candidate is None else candidate.pixels(shape, 1.0)
    if depth is not None and frame.depth is not None:
        depths = frame.depth.part(box)
        if depths.shape == mask.shape:
            mask = mask & ~(np.abs(depths - depth) > _DEPTH)  # unknown depths are included
    chosen = np.ascontiguousarray(mask, np.uint8)
    counts = cv2.calcHist([part], [0, 1, 2], chosen, list(_BINS), [0, 180, 0, 256, 0, 256])
    total = float(counts.sum())
    return np.asarray(counts.ravel() / total, np.float32) if total else _NOTHING
