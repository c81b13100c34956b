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
from head_tracking.vision.identity import Identity, IdentityParameters, Located, Track
from head_tracking.vision.images import ImageError
from head_tracking.vision.looks import colours_of
from head_tracking.vision.opencv import cv2

_LONGEST_PAUSE = 5.0  # s
_HINTED = 0.3  # s after a loss in which the predicted position is a hint
_ANOTHER = 0.5  # m
_SELECTION = 10  # images in which a selected object may be detected


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
    """Tracks one target in images.

    Attributes:
        detector: detects candidates.
        distances: limits and assumption of distances.
        identity: the tracks.
        without_distance: number of detections in the latest image without a known distance.
    """

    def __init__(
        self, detector: Detector, distances: DistanceParameters, identity: IdentityParameters
    ) -> None:
        self.detector = detector
        self.distances = distances
        self.identity = Identity(identity)
        self.without_distance = 0
        self._stamp: int | None = None
        self._wanted: Box | None = None
        self._patience = 0

    @property
    def tracks(self) -> Sequence[Track]:
        """All tracks."""
        return self.identity.tracks

    def step(self, frame: Frame, T_fixed_optical: Transform | None = None) -> Sighting | None:
        """Return the target in an image; None: not visible.

        Args:
            frame: the image with its camera and depths.
            T_fixed_optical: pose of the camera in the fixed frame at the time of the image; None:
                the camera does not move.

        Raises:
            ImageError: the sizes of picture, depth and camera differ.
        """
        _check_sizes(frame)
        self._begin(frame.stamp)
        pose = T_fixed_optical or Transform.identity()
        try:
            candidates = self.detector.detect(frame, self._hints(frame, pose))
        except cv2.error as error:
            raise ImageError(f"OpenCV cannot process this image: {error}") from error
        located = [found for c in candidates if (found := self._locate(frame, c)) is not None]
        self.without_distance = len(candidates) - len(located)
        return self._associate(frame.stamp, located, pose)

    def update(
        self, stamp: int, located: Sequence[Located], T_fixed_frame: Transform | None = None
    ) -> Sighting | None:
        """Return the target among detections with known positions; None: not detected.

        Args:
            stamp: time of the detections [ns].
            located: the detections, in any frame.
            T_fixed_frame: pose of that frame in the fixed frame; None: it does not move.
        """
        self._begin(stamp)
        return self._associate(stamp, located, T_fixed_frame or Transform.identity())

    def select(self, frame: Frame, box: Box) -> None:
        """Follow the object in a box that a user has drawn."""
        self.detector.select(frame, box)
        self._wanted, self._patience = box, _SELECTION
        if not self._follow_wanted():
            self.identity.reset()

    def select_point(self, point: Vector3) -> bool:
        """Follow the track nearest to a point in the fixed frame [m]; return whether there is one.

        A track farther away than 0.5 m is another object.
        """
        near = [t for t in self.tracks if t.believed and math.dist(t.position, point) < _ANOTHER]
        if near:
            self.identity.follow(min(near, key=lambda track: math.dist(track.position, point)))
        return bool(near)

    def reset(self) -> None:
        """Delete all tracks and the selection."""
        self.identity.reset()
        self.detector.reset()
        self._wanted = None

    def _begin(self, stamp: int) -> None:
        if self._stamp is not None:
            pause = (stamp - self._stamp) * 1e-9
            if not 0.0 <= pause <= _LONGEST_PAUSE:
                self.identity.reset()
        self._stamp = stamp

    def _associate(
        self, stamp: int, located: Sequence[Located], pose: Transform
    ) -> Sighting | None:
        """Assign an identity to every candidate and return the followed one."""
        self.identity.update(located, pose, stamp * 1e-9)
        self._follow_wanted()
        track = self.identity.sighted
        if track is None:
            return None
        found = track.latest
        return Sighting(stamp, found.point, track.confidence, found.candidate, track.number)

    def _follow_wanted(self) -> bool:
        """Follow a track in the selected box; return whether there is one."""
        if self._wanted is None:
            return False
        middle = self._wanted.centre
        inside = [
            (math.dist(track.located.candidate.centre, middle), track)
            for track in self.tracks
            if track.located is not None and self._wanted.contains(track.located.candidate.centre)
        ]
        if not inside:
            self._patience -= 1
            if self._patience < 0:
                self._wanted = None
            return False
        self.identity.follow(min(inside, key=lambda item: item[0])[1])
        self._wanted = None
        return True

    def _hints(self, frame: Frame, pose: Transform) -> list[Box]:
        """Return the predicted boxes of the tracks."""
        T_optical_fixed = pose.inverse()
        hints = []
        now = frame.stamp * 1e-9
        for track in self.tracks:
            if now - track.seen > _HINTED:
                continue
            ahead = track.position + track.velocity * (now - track.now)
            pixel = frame.camera.pixel(T_optical_fixed @ ahead.tolist())
            if pixel is not None:
                box = track.latest.candidate.box
                hints.append(
                    Box(pixel[0] - box.width / 2, pixel[1] - box.height / 2, box.width, box.height)
                )
        return hints

    def _locate(self, frame: Frame, candidate: Candidate) -> Located | None:
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
        if not all(map(math.isfinite, point)):
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


def _check_sizes(frame: Frame) -> None:
    camera = (frame.camera.width, frame.camera.height)
    for what, image in (("picture", frame.picture), ("depth image", frame.depth)):
        if image is not None and image.size != camera:
            raise ImageError(
                f"the {what} has {image.size[0]}x{image.size[1]} pixels and camera_info says "
                f"{camera[0]}x{camera[1]}; picture, aligned depth and camera_info must agree"
            )
