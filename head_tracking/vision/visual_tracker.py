"""From images to a point in space: detection, distance, identity."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from head_tracking.parameters import parameter
from head_tracking.transforms import Transform, Vector3
from head_tracking.vision.camera import Box
from head_tracking.vision.candidate import Candidate, Detector, Frame, ellipse_mask
from head_tracking.vision.depth import surface_depth
from head_tracking.vision.identity import Identity, IdentityParameters, Located, Track
from head_tracking.vision.images import ImageError
from head_tracking.vision.looks import colours_of
from head_tracking.vision.opencv import cv2

_LONGEST_PAUSE = 5.0  # s
_LOOKED_FOR = 0.3  # s for which a thing that was lost is looked for where it should be
_SEARCHED_FOR = 10  # images in which what a person has selected may be found


@dataclass(frozen=True, slots=True)
class DistanceParameters:
    """How far away things may be, and what to take where no depth is measured."""

    min_distance: float = parameter(
        0.2, "Nearer depths do not count.", unit="m", minimum=0.01, maximum=100.0
    )
    max_distance: float = parameter(
        8.0, "Farther depths do not count.", unit="m", minimum=0.02, maximum=1000.0
    )
    object_size: float = parameter(
        0.0,
        "True width of what is followed: tells its distance where there is no depth; 0: unknown.",
        unit="m",
        minimum=0.0,
        maximum=100.0,
    )
    distance: float = parameter(
        0.0,
        "Distance to assume where there is neither depth nor size; 0: such targets are left out.",
        unit="m",
        minimum=0.0,
        maximum=1000.0,
    )

    def __post_init__(self) -> None:
        if self.min_distance >= self.max_distance:
            raise ValueError(
                f"min_distance is {self.min_distance} and max_distance {self.max_distance}; the "
                "first must be smaller"
            )


@dataclass(frozen=True, slots=True)
class Sighting:
    """The target in one image.

    Attributes:
        stamp: when the image was taken [ns].
        point: where the target is in the optical frame [m].
        confidence: 0 to 1.
        candidate: what the detector found.
        number: of the thing; it stays the same while it is the same thing.
    """

    stamp: int
    point: Vector3
    confidence: float
    candidate: Candidate
    number: int


class VisualTracker:
    """Finds one target in images, and keeps to it."""

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
        """Everything that is known at the moment."""
        return self.identity.tracks

    def step(self, frame: Frame, T_fixed_optical: Transform | None = None) -> Sighting | None:
        """The target in an image; None if it is not seen there.

        Args:
            frame: the image with its camera and depth.
            T_fixed_optical: the camera's pose in a frame that stands still, when the image was
                taken; None: the camera is taken to stand still.

        Raises:
            ImageError: the sizes of picture, depth and camera differ.
        """
        _check_sizes(frame)
        self._begin(frame.stamp)
        pose = T_fixed_optical or Transform.identity()
        try:
            candidates = self.detector.detect(frame, self._hints(frame, pose))
        except cv2.error as error:
            raise ImageError(f"OpenCV can do nothing with this image: {error}") from error
        located = [place for c in candidates if (place := self._locate(frame, c)) is not None]
        self.without_distance = len(candidates) - len(located)
        return self._keep(frame.stamp, located, pose)

    def place(
        self, stamp: int, located: Sequence[Located], T_fixed_frame: Transform | None = None
    ) -> Sighting | None:
        """The target among things whose places are known without an image; None: it is not there.

        Args:
            stamp: when they were there [ns].
            located: in any frame.
            T_fixed_frame: that frame in one that stands still; None: it does so itself.
        """
        self._begin(stamp)
        return self._keep(stamp, located, T_fixed_frame or Transform.identity())

    def select(self, frame: Frame, box: Box) -> None:
        """A person has drawn a rectangle around the target."""
        self.detector.select(frame, box)
        self._wanted, self._patience = box, _SEARCHED_FOR
        if not self._follow_wanted():
            self.identity.reset()

    def reset(self) -> None:
        """Forgets the target and what a person has selected."""
        self.identity.reset()
        self.detector.reset()
        self._wanted = None

    def _begin(self, stamp: int) -> None:
        if self._stamp is not None:
            pause = (stamp - self._stamp) * 1e-9
            if not 0.0 <= pause <= _LONGEST_PAUSE:
                self.identity.reset()
        self._stamp = stamp

    def _keep(self, stamp: int, located: Sequence[Located], pose: Transform) -> Sighting | None:
        """Tells who is who; the target."""
        self.identity.update(located, pose, stamp * 1e-9)
        self._follow_wanted()
        track = self.identity.sighted
        if track is None:
            return None
        found = track.latest
        return Sighting(stamp, found.point, track.confidence, found.candidate, track.number)

    def _follow_wanted(self) -> bool:
        """Keeps to what is in the rectangle that a person has drawn, as soon as it is seen."""
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
        """Where things that are believed should be in the image now."""
        T_optical_fixed = pose.inverse()
        hints = []
        now = frame.stamp * 1e-9
        for track in self.tracks:
            if now - track.seen > _LOOKED_FOR:
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
        """The candidate with its place; None if its distance is not known."""
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
        looks = colours_of(frame, candidate, depth)
        return Located(candidate, point, known, radius, looks)

    def _depth(self, frame: Frame, candidate: Candidate) -> float | None:
        if frame.depth is None:
            return None
        box = candidate.box
        depths = frame.depth.part(box)
        mask = candidate.mask
        if mask is None or mask.shape != depths.shape:
            mask = ellipse_mask(*depths.shape)
        d = self.distances
        found = surface_depth(depths[mask], d.min_distance, d.max_distance)
        return None if found is None else found.metres

    def _assumed_distance(self, frame: Frame, candidate: Candidate) -> float:
        """The distance from the camera [m]; 0: unknown."""
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
