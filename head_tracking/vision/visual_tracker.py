"""Track one target in images: detection, distance, identity."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from head_tracking.parameters import parameter
from head_tracking.transforms import Transform, Vector3
from head_tracking.vision.camera import Box
from head_tracking.vision.candidate import Candidate, Detector, Frame
from head_tracking.vision.depth import surface_depth
from head_tracking.vision.identity import (
    IdentityParameters,
    Located,
    Track,
    colours_of,
    is_possible,
)
from head_tracking.vision.images import ImageError
from head_tracking.vision.opencv import cv2

_LONGEST_PAUSE = 5.0  # s
_LATEST = 1.0  # s by which an image may be late, and is ignored; more: the clock was set back
_HINTED = 0.3  # s after a loss in which the predicted position is a hint
_ANOTHER = 0.5  # m


@dataclass(frozen=True, slots=True)
class DistanceParameters:
    """Limits of measured depths, and the distance where no depth is measured."""

    min_distance: float = parameter(0.2, "Minimum depth.", unit="m", minimum=0.01, maximum=100.0)
    max_distance: float = parameter(8.0, "Maximum depth.", unit="m", minimum=0.02, maximum=1000.0)
    object_size: float = parameter(
        0.0,
        "Width of the object, to estimate the distance without depths; 0: unknown.",
        unit="m",
        minimum=0.0,
        maximum=100.0,
    )
    distance: float = parameter(
        0.0,
        "Assumed distance without depth and object_size; 0: publish no target then.",
        unit="m",
        minimum=0.0,
        maximum=1000.0,
    )

    def __post_init__(self) -> None:
        if self.min_distance >= self.max_distance:
            raise ValueError(
                f"min_distance is {self.min_distance} and max_distance {self.max_distance}; "
                "min_distance must be smaller"
            )


@dataclass(frozen=True, slots=True)
class Sighting:
    """The target in one image.

    Attributes:
        stamp: time of the image [ns].
        point: position in the optical frame [m].
        confidence: 0 to 1.
        candidate: the detection.
        number: number of the track.
    """

    stamp: int
    point: Vector3
    confidence: float
    candidate: Candidate
    number: int


class VisualTracker:
    """Tracks objects in images, and follows one of them.

    Args:
        detector: detects candidates; None: nothing is detected.
        distances: limits and assumption of distances.
        identity: confirmation and loss of tracks.

    Attributes:
        detector: as above; so are `distances` and `identity`. They may be changed at any time.
        tracks: the objects.
        followed: one of them, visible or not; None: none.
        has_pose: whether the pose of the camera was known for the latest image: tracks are in the
            fixed frame then, else in that of the camera.
        without_distance: number of detections in the latest image without a known distance.
        doubted: the confidence of what is seen and, as it is too low, not published; else None.
        late: by how much the latest image is older than the one before [s]; 0: it is not.
    """

    def __init__(
        self,
        detector: Detector | None,
        distances: DistanceParameters,
        identity: IdentityParameters,
    ) -> None:
        self.detector, self.distances, self.identity = detector, distances, identity
        self.tracks: list[Track] = []
        self.followed: Track | None = None
        self.has_pose = False
        self.without_distance = 0
        self.doubted: float | None = None
        self.late = 0.0
        self._number = 0
        self._stamp: int | None = None

    def step(self, frame: Frame, T_fixed_optical: Transform | None = None) -> Sighting | None:
        """Return the target in an image; None: not visible.

        Args:
            frame: the image with its camera and depths.
            T_fixed_optical: pose of the camera in the fixed frame at the time of the image; None:
                the camera does not move.

        Raises:
            ImageError: OpenCV cannot process the image.
        """
        try:
            hints = self._hints(frame, T_fixed_optical or Transform.identity())
            found = [] if self.detector is None else self.detector.detect(frame, hints)
        except cv2.error as error:
            raise ImageError(f"OpenCV cannot process this image: {error}") from error
        return self.update(frame.stamp, self.locate(frame, found), T_fixed_optical)

    def locate(self, frame: Frame, candidates: Sequence[Candidate]) -> list[Located]:
        """Return the candidates in an image whose distance is known, with their positions."""
        located = [found for c in candidates if (found := self._located(frame, c)) is not None]
        self.without_distance = len(candidates) - len(located)
        return located

    def update(
        self, stamp: int, located: Sequence[Located], T_fixed_frame: Transform | None = None
    ) -> Sighting | None:
        """Return the target among detections with known positions; None: not detected.

        Args:
            stamp: time of the detections [ns].
            located: the detections, in any frame.
            T_fixed_frame: pose of that frame in the fixed frame; None: it does not move.
        """
        self.late = 0.0 if self._stamp is None else max(0.0, (self._stamp - stamp) * 1e-9)
        if 0.0 < self.late <= _LATEST:
            return None
        self._restart_after_pause(stamp, T_fixed_frame is not None)
        self._assign(located, T_fixed_frame or Transform.identity(), stamp * 1e-9)
        if self.followed not in self.tracks:
            certain = filter(self._is_certain, self.tracks)
            self.followed = max(certain, key=lambda t: t.latest.candidate.box.width, default=None)
        track, self.doubted = self.followed, None
        if track is None or not self._is_certain(track):
            tracks = self.tracks if track is None else [track]
            seen = [each.confidence for each in tracks if each.located and each.believed]
            self.doubted = max(seen, default=None)
            return None
        found = track.latest
        return Sighting(stamp, found.point, track.confidence, found.candidate, track.number)

    def select(self, frame: Frame, box: Box) -> None:
        """Follow the object in a box that a user has drawn, if the detector learns it."""
        if self.detector is not None:
            self.detector.select(frame, box)
        self._restart()

    def select_point(self, point: Vector3) -> bool:
        """Follow the track nearest to a point in the fixed frame [m]; return whether there is one.

        A track farther away than 0.5 m is another object.
        """
        near = [t for t in self.tracks if t.believed and math.dist(t.position, point) < _ANOTHER]
        if near:
            self.followed = min(near, key=lambda track: math.dist(track.position, point))
        return bool(near)

    def reset(self) -> None:
        """Delete all tracks and the selection."""
        self._restart()
        if self.detector is not None:
            self.detector.reset()

    def _restart(self) -> None:
        self.tracks, self.followed = [], None

    def _restart_after_pause(self, stamp: int, has_pose: bool) -> None:
        """Delete all tracks after a pause, and when the pose is not known any more, or again."""
        pause = 0.0 if self._stamp is None else (stamp - self._stamp) * 1e-9
        if has_pose != self.has_pose or not 0.0 <= pause <= _LONGEST_PAUSE:
            self._restart()
        self._stamp, self.has_pose = stamp, has_pose

    def _assign(self, found: Sequence[Located], T_fixed_optical: Transform, now: float) -> None:
        """Update the tracks with the detections of one image, the cheapest pair first."""
        for track in self.tracks:
            track.predict(now)
        T_optical_fixed = T_fixed_optical.inverse()
        costs = (
            (track.cost(located, T_optical_fixed), i, j)
            for i, track in enumerate(self.tracks)
            for j, located in enumerate(found)
        )
        pairs: dict[int, int] = {}
        for cost, i, j in sorted(costs):
            if cost < math.inf and i not in pairs and j not in pairs.values():
                pairs[i] = j
        for i, track in enumerate(self.tracks):
            if i in pairs:
                located = found[pairs[i]]
                track.update(located, T_fixed_optical, learn=_is_alone(located, found))
            else:
                track.missed()
        for j, located in enumerate(found):
            if j not in pairs.values():
                self._number += 1
                self.tracks.append(Track(self._number, located, T_fixed_optical, now))
        self.tracks = [track for track in self.tracks if self._is_kept(track, now)]

    def _is_kept(self, track: Track, now: float) -> bool:
        track.believed |= sum(track.recent) >= self.identity.confirm_images
        if track.believed:
            return now - track.seen <= self.identity.memory
        return any(track.recent[-3:])

    def _is_certain(self, track: Track) -> bool:
        is_visible = track.located is not None and track.believed
        return is_visible and track.confidence >= self.identity.min_confidence

    def _hints(self, frame: Frame, pose: Transform) -> list[Box]:
        """Return the predicted boxes of the tracks."""
        T_optical_fixed = pose.inverse()
        hints = []
        now = frame.stamp * 1e-9
        for track in self.tracks:
            if not 0.0 <= now - track.seen <= _HINTED:
                continue
            ahead = track.position + track.velocity * (now - track.now)
            pixel = frame.camera.pixel(T_optical_fixed @ ahead.tolist())
            if pixel is not None:
                box = track.latest.candidate.box
                hints.append(
                    Box(pixel[0] - box.width / 2, pixel[1] - box.height / 2, box.width, box.height)
                )
        return hints

    def _located(self, frame: Frame, candidate: Candidate) -> Located | None:
        """Return a candidate with its position; None: its distance is not known."""
        depth = self._depth(frame, candidate)
        if depth is not None:
            point = frame.camera.point(candidate.centre, depth)
        elif candidate.position is not None:
            point = candidate.position
        else:
            x, y = frame.camera.ray(candidate.centre)
            away = self._assumed_distance(frame, candidate)
            if not away:
                return None
            length = math.sqrt(1.0 + x * x + y * y)
            point = (x / length * away, y / length * away, away / length)
        if not is_possible(point):
            return None
        known = depth is not None or candidate.position is not None
        radius = candidate.box.width / 2 / frame.camera.focal_length()
        if frame.picture is None:
            return Located(candidate, point, known, radius)
        return Located(candidate, point, known, radius, colours_of(frame, candidate, depth))

    def _depth(self, frame: Frame, candidate: Candidate) -> float | None:
        if frame.depth is None:
            return None
        depths, d = frame.depth.part(candidate.box), self.distances
        inside = depths[candidate.pixels(depths.shape, 0.7)]
        return surface_depth(inside, d.min_distance, d.max_distance)

    def _assumed_distance(self, frame: Frame, candidate: Candidate) -> float:
        """Return the distance from the camera without depths [m]; 0: unknown."""
        size = self.distances.object_size
        if size and candidate.box.width > 0:
            return frame.camera.focal_length() * size / candidate.box.width
        return self.distances.distance


def _is_alone(located: Located, found: Sequence[Located]) -> bool:
    """Return whether no other detection is near."""
    candidate = located.candidate
    return all(
        math.dist(candidate.centre, other.candidate.centre) > 2.0 * candidate.box.width
        for other in found
        if other is not located
    )
