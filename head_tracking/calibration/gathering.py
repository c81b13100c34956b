"""Views of a marker for a calibration: the head looks around by itself, slowly."""

from __future__ import annotations

import math
import random
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Final, Protocol

import numpy as np

from head_tracking.calibration.geometry import HeadGeometry
from head_tracking.calibration.result import Calibration
from head_tracking.calibration.solver import CalibrationError, Reason, View, solve
from head_tracking.exceptions import UnreachableError
from head_tracking.transforms import LATEST, TransformBuffer, Vector3
from head_tracking.vision.camera import Camera, camera_with_view
from head_tracking.vision.camera_follower import DEFAULT_VIEW, pictures
from head_tracking.vision.candidate import Frame
from head_tracking.vision.images import Picture, Pixels
from head_tracking.vision.markers import MarkerDetector, MarkerParameters

MOST_VIEWS: Final = 25
LONGEST: Final = 90.0  # s

_SPEED: Final = 0.6  # rad/s
_SETTLING: Final = 0.4  # s after an arrival: a camera's pictures come late
_STILL: Final = 1.0  # px between two pictures
_PATIENCE: Final = 1.5  # s for a still picture of a marker
_LATE: Final = 0.5  # s that a measurement of the joints may come after a picture
_POLL: Final = 0.005  # s
_REACH: Final = 0.75  # of half the picture, to which the marker is brought
_DISTANCE: Final = 2.0  # m: of what is looked at
_STEPS: Final = 5  # in each direction
_CROSSED: Final = math.radians(3.0)  # a joint that has turned so far has crossed its play
_STOOD: Final = math.radians(0.3)  # one that has turned less stands where it stood in its play


class TurningHead(Protocol):
    """What looks around; `Head` is one."""

    @property
    def frames(self) -> TransformBuffer:
        """The robot's frames."""

    @property
    def joints(self) -> Mapping[str, float]:
        """The measured positions of pan and tilt [rad]."""

    def look_at(self, point: Vector3, frame: str, *, max_velocity: float) -> object:
        """Turn to a point [m], at most at this speed [rad/s]; wait for the arrival."""


def calibrate_camera(
    head: TurningHead,
    camera: int | str | Iterable[tuple[float, Pixels]] = 0,
    *,
    marker: MarkerParameters,
    frame: str = "camera_optical_frame",
    model: Camera | None = None,
    focal_length: bool = False,
    report: Callable[[str], object] = lambda text: None,
) -> Calibration:
    """Find out where the camera sits: the head looks around a marker, at most 25 views and 90 s.

    The marker stands still and is in view at first. `head.stop()` from any thread ends it.

    Args:
        head: that carries the camera.
        camera: number, device, file or URL; or pictures (blue, green, red; shape (height, width,
            3)) with their times [s, as time.time()].
        marker: which one, and how wide it is.
        frame: the camera's optical frame.
        model: of the camera; None: one that sees 60 degrees from left to right.
        focal_length: whether to estimate that, too.
        report: told in a sentence what goes on.

    Returns:
        The calibration; nothing is written, and the head's model stays as it is.

    Raises:
        CalibrationError: no picture comes, the marker is not seen, or the views contradict each
            other or the model.
        RefusedCommandError: the head is stopped, relaxed or closed.
        FrameError: the frame is not known.
        ValueError: the marker has no size.
    """
    if marker.marker_size <= 0.0:
        raise ValueError("the marker needs a size above 0: the edge of its black square, in metres")
    robot = head.frames.model
    assert robot is not None
    pan, tilt = head.joints
    geometry = HeadGeometry.of(robot, pan, tilt, frame)
    source = iter(pictures(camera) if isinstance(camera, int | str) else camera)
    _, first = next(source, (0.0, None))
    if first is None:
        raise _no_picture()
    height, width = first.shape[:2]
    lens = model or camera_with_view(width, height, DEFAULT_VIEW)
    views = _gather(_Observer(head, source, lens, marker), head, geometry, lens, report)
    report(f"{len(views)} views; computing")
    return Calibration.of(
        geometry, solve(geometry, lens, views, marker.marker_size, focal_length=focal_length)
    )


class _Observer:
    """Takes views with a camera on the head.

    Args:
        head: that carries the camera.
        source: of pictures with their times [s].
        camera: its lens.
        marker: which one counts.
    """

    def __init__(
        self,
        head: TurningHead,
        source: Iterator[tuple[float, Pixels]],
        camera: Camera,
        marker: MarkerParameters,
    ) -> None:
        self._head, self._source, self._camera = head, source, camera
        self._detector = MarkerDetector(marker)
        self._positions, self._directions = tuple(head.joints.values()), [0, 0]

    def views(self) -> list[View]:
        """Return the markers that are seen as soon as the pictures stand still; none: no marker.

        The joints stand from a measurement before these pictures to one after them: on a busy
        computer measurements come late, and the head may begin to turn late.
        """
        self._note_motion()
        arrived = self._measured()
        end = arrived + _SETTLING + _PATIENCE
        before: dict[int, View] = {}
        for stamp, picture in self._source:
            if stamp < arrived + _SETTLING:
                continue
            self._wait_for_joints(stamp)
            if self._note_motion():
                arrived, found = self._measured(), {}
            else:
                found = self._detect(stamp, picture)
            still = [
                view
                for number, view in found.items()
                if number in before
                and float(np.abs(view.corners - before[number].corners).max()) < _STILL
            ]
            if still or stamp > end:
                return still
            before = found
        raise _no_picture()

    def _detect(self, stamp: float, picture: Pixels) -> dict[int, View]:
        frame = Frame(round(stamp * 1e9), self._camera, Picture(picture))
        pan, tilt = self._head.joints.values()
        directions = self._directions[0], self._directions[1]
        return {
            int(each.label): View(
                pan, tilt, int(each.label), np.asarray(each.points, float), directions
            )
            for each in self._detector.detect(frame, [])
        }

    def _measured(self) -> float:
        """Return when the joints were measured last [s]."""
        found = map(self._head.frames.latest_joint_position, self._head.joints)
        return min((each[0] * 1e-9 for each in found if each is not None), default=-math.inf)

    def _wait_for_joints(self, stamp: float) -> None:
        """Wait until the joints have been measured after a picture.

        Where the camera's clock is ahead of the joints', that takes too long to be waited for.
        """
        end = time.monotonic() + _LATE
        while self._measured() < stamp and time.monotonic() < end:
            time.sleep(_POLL)

    def _note_motion(self) -> bool:
        """Return whether a joint has turned since it was asked last; note in which direction."""
        positions = tuple(self._head.joints.values())
        ways = [now - before for before, now in zip(self._positions, positions, strict=True)]
        if all(abs(way) <= _STOOD for way in ways):
            return False
        for joint, way in enumerate(ways):
            if abs(way) > _CROSSED:
                self._directions[joint] = 1 if way > 0.0 else -1
            elif abs(way) > _STOOD:
                self._directions[joint] = 0
        self._positions = positions
        return True


def _no_picture() -> CalibrationError:
    return CalibrationError(
        Reason.NO_PICTURE,
        "the camera sends no more pictures: see that it is plugged in and that no other program "
        "has opened it, and calibrate again",
    )


def _gather(
    observer: _Observer,
    head: TurningHead,
    geometry: HeadGeometry,
    camera: Camera,
    report: Callable[[str], object],
) -> list[View]:
    """Return views in which the marker is all over the picture, in a random order.

    In that order what slips on the way cannot be mistaken for a wrong mounting.
    """
    end = time.monotonic() + LONGEST
    views = observer.views()
    if not views:
        raise CalibrationError(
            Reason.FEW_VIEWS,
            "no marker is in view: turn the head or the marker so that the camera sees it, and "
            "give its family and number",
        )
    directions = _directions(camera)
    random.Random(1).shuffle(directions)
    directions = directions[: MOST_VIEWS - 1]
    nearest = views[0]
    for number, (right, down) in enumerate(directions, 1):
        if time.monotonic() > end:
            break
        report(f"direction {number} of {len(directions)}; markers seen so far: {len(views)}")
        try:
            head.look_at(
                _point_beside(head, geometry, camera, nearest, right, down),
                geometry.base,
                max_velocity=_SPEED,
            )
        except UnreachableError:
            continue
        views += observer.views()
    return views


def _directions(camera: Camera) -> list[tuple[float, float]]:
    """Return where to bring the marker in the picture: x and y at z = 1 from its middle."""
    across = _REACH * camera.width / 2.0 / camera.fx
    down = _REACH * camera.height / 2.0 / camera.fy
    steps = np.linspace(-1.0, 1.0, _STEPS)
    return [(float(across * x), float(down * y)) for x in steps for y in steps]


def _point_beside(
    head: TurningHead, geometry: HeadGeometry, camera: Camera, seen: View, right: float, down: float
) -> tuple[float, float, float]:
    """Return what to look at so that a marker comes to x and y, at z = 1, in the picture [m]."""
    u, v = seen.corners.mean(axis=0).tolist()
    x, y = camera.ray((u, v))
    joints = dict(zip(head.joints, (seen.pan, seen.tilt), strict=True))
    optical = head.frames.lookup_transform(
        geometry.base, geometry.optical_frame, LATEST, joint_positions=joints
    ).transform
    length = _DISTANCE / math.sqrt(1.0 + (x - right) ** 2 + (y - down) ** 2)
    return optical @ (length * (x - right), length * (y - down), length)
