"""Identity of objects from image to image: data association and track management."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from head_tracking.parameters import parameter
from head_tracking.transforms import Transform, Vector3
from head_tracking.vision.candidate import Candidate
from head_tracking.vision.looks import Appearance, appearance_distance

Vector: TypeAlias = npt.NDArray[np.float64]

_ACCELERATION = 2.0  # m/s²: process noise
_CONFIRMED_OF = 5  # images
_IMPOSSIBLE = 1e6
_FARTHEST = 0.5
"""Maximum distance [m] from the predicted position after a loss. Without this limit the gate would
grow with time, and so the risk of taking over another person."""
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

    def __init__(self, number: int, located: Located, position: Vector, now: float) -> None:
        self.number = number
        self.position = position
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

    def update(self, located: Located, position: Vector, spread: float) -> None:
        """Correct by a detection with a standard deviation [m]."""
        gain = self.covariance[:, 0] / (self.covariance[0, 0] + spread**2)
        change = position - self.position
        self.position = self.position + gain[0] * change
        self.velocity = self.velocity + gain[1] * change
        self.covariance = self.covariance - np.outer(gain, self.covariance[0])
        self.seen, self.latest = self.now, located
        self.confidence += 0.3 * (located.candidate.confidence - self.confidence)
        self._remember(True)

    def missed(self) -> None:
        """Record a missing detection."""
        self.confidence *= 0.8
        self._remember(False)

    def _remember(self, found: bool) -> None:
        self.recent = [*self.recent[-_CONFIRMED_OF + 1 :], found]


class Identity:
    """Assigns detections to tracks by position, motion and appearance, and follows one track."""

    def __init__(self, parameters: IdentityParameters) -> None:
        self.parameters = parameters
        self.tracks: list[Track] = []
        self.followed: Track | None = None
        self._number = 0

    @property
    def sighted(self) -> Track | None:
        """The followed track if it is confirmed, certain, and detected in the latest image."""
        track = self.followed
        return track if track is not None and self._is_certain(track) else None

    def reset(self) -> None:
        """Delete all tracks."""
        self.tracks, self.followed = [], None

    def update(self, found: Sequence[Located], T_fixed_optical: Transform, now: float) -> None:
        """Update the tracks with the detections of one image.

        Args:
            found: detections in the optical frame.
            T_fixed_optical: pose of the camera in the fixed frame.
            now: time of the image [s].
        """
        for track in self.tracks:
            track.predict(now)
        T_optical_fixed = T_fixed_optical.inverse()
        costs = np.array(
            [[self._cost(track, located, T_optical_fixed) for located in found]
             for track in self.tracks]
        ).reshape(len(self.tracks), len(found))  # fmt: skip
        pairs = _cheapest_pairs(costs)
        assigned = set(pairs.values())
        for i, track in enumerate(self.tracks):
            if i in pairs:
                self._correct(track, found, pairs[i], T_fixed_optical)
            else:
                track.missed()
        for j, located in enumerate(found):
            if j not in assigned:
                self._number += 1
                position = np.array(T_fixed_optical @ located.point)
                self.tracks.append(Track(self._number, located, position, now))
        self.tracks = [track for track in self.tracks if self._is_kept(track, now)]
        self._choose()

    def follow(self, track: Track) -> None:
        """Follow this track."""
        self.followed = track

    def _correct(
        self, track: Track, found: Sequence[Located], index: int, T_fixed_optical: Transform
    ) -> None:
        located = found[index]
        distance = math.hypot(*located.point)
        spread = 0.01 * distance if located.depth_known else 0.03 * distance
        track.update(located, np.array(T_fixed_optical @ located.point), spread)
        alone = all(
            math.dist(located.candidate.centre, other.candidate.centre)
            > 2.0 * located.candidate.box.width
            for other in found
            if other is not located
        )
        if alone and located.appearance.shape == track.appearance.shape:
            track.appearance = 0.95 * track.appearance + 0.05 * located.appearance

    def _cost(self, track: Track, located: Located, T_optical_fixed: Transform) -> float:
        """Return the cost of assigning a detection to a track."""
        if located.candidate.label != track.label:
            return _IMPOSSIBLE
        if located.candidate.unique:
            return 0.0
        expected = T_optical_fixed @ track.position.tolist()
        away, distance = math.hypot(*expected), math.hypot(*located.point)
        if away < 1e-6 or distance < 1e-6:
            return _IMPOSSIBLE
        cosine = sum(a * b for a, b in zip(expected, located.point, strict=True)) / away / distance
        angle = math.acos(max(-1.0, min(1.0, cosine)))
        unknown = min(_FARTHEST, 3.0 * math.sqrt(track.covariance[0, 0]))
        reach = 0.03 + located.radius + unknown / away
        ratio = abs(math.log(distance / away))
        measured = located.depth_known and track.latest.depth_known
        if measured and abs(distance - away) > unknown + 0.1 * away:
            return _IMPOSSIBLE
        lost, here = not track.recent[-1], angle <= 0.03 + located.radius
        if angle > reach or ratio > 0.7 or (lost and angle * away > _FARTHEST):
            return _IMPOSSIBLE
        difference = appearance_distance(track.appearance, located.appearance)
        if difference > (_MOST_DIFFERENT if here and not lost else _MOST_DIFFERENT_AFTER_LOSS):
            return _IMPOSSIBLE
        return angle / reach + 2.0 * ratio + 3.0 * difference

    def _is_kept(self, track: Track, now: float) -> bool:
        track.believed |= sum(track.recent) >= self.parameters.confirm_images
        if track.believed:
            return now - track.seen <= self.parameters.memory
        return any(track.recent[-3:])

    def _choose(self) -> None:
        if self.followed is not None and self.followed in self.tracks:
            return
        self.followed = max(
            filter(self._is_certain, self.tracks),
            key=lambda track: track.latest.candidate.box.width,
            default=None,
        )

    def _is_certain(self, track: Track) -> bool:
        is_visible = track.located is not None and track.believed
        return is_visible and track.confidence >= self.parameters.min_confidence


def _cheapest_pairs(costs: Vector) -> dict[int, int]:
    """Return the column of each row: the cheapest pair first, then the cheapest of the others."""
    pairs: dict[int, int] = {}
    for index in np.argsort(costs, axis=None).tolist():
        row, column = divmod(index, costs.shape[1])
        if costs[row, column] < _IMPOSSIBLE and row not in pairs and column not in pairs.values():
            pairs[row] = column
    return pairs
