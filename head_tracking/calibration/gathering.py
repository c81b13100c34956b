"""Record views of a marker, a face or the room while the head moves slowly."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import product
from typing import Final, Protocol

import numpy as np

from head_tracking.calibration.geometry import AHEAD, PARAMETERS, Array, HeadGeometry
from head_tracking.calibration.result import Calibration
from head_tracking.calibration.solver import CalibrationError, Reason, View, solve
from head_tracking.calibration.targets import TARGETS, Observe, observer, what_to_show
from head_tracking.exceptions import FrameError, SupersededError, UnreachableError
from head_tracking.gaze import PanTiltHead
from head_tracking.parameters import check_kind
from head_tracking.transforms import JointLimits, TransformBuffer, Vector3
from head_tracking.vision.camera import Camera, camera_with_view
from head_tracking.vision.camera_follower import DEFAULT_VIEW, checked_pictures
from head_tracking.vision.candidate import Frame
from head_tracking.vision.images import Picture, Pixels
from head_tracking.vision.markers import MarkerParameters

MOST_VIEWS: Final = 25
LONGEST: Final = 90.0  # s

_SPEED: Final = 0.6  # rad/s
_SETTLING: Final = 0.4  # s after an arrival, because images are late
_PATIENCE: Final = 1.5  # s to wait for a still image,
_COMPARED: Final = 4  # and minimum number of images: a busy computer is late
_LONGEST_STOP: Final = 10.0  # s in which the head comes to rest
_LATE: Final = 0.5  # s: maximum delay of joint measurements after an image
_POLL: Final = 0.005  # s
_OLDEST: Final = 10.0  # s: an image that is so much older than the joints has another clock
_RETRY: Final = 0.2  # s
_REACH: Final = 0.75  # of half the image: range of positions of the target
_DISTANCE: Final = 2.0  # m: distance of the points to look at
_MARGIN: Final = 0.01  # rad: minimum distance from a limit
_STEPS: Final = 5  # in each direction
_CROSSED: Final = math.radians(3.0)  # motion after which the play is certainly crossed
_NO_ERRORS: Final = np.zeros(len(PARAMETERS))
_STOOD: Final = math.radians(0.3)  # smaller motion does not change the position in the play


class TurningHead(Protocol):
    """Interface of a head for a calibration; `Head` implements it."""

    @property
    def frames(self) -> TransformBuffer:
        """The frames of the robot."""

    @property
    def joints(self) -> Mapping[str, float]:
        """The measured positions of pan and tilt [rad]."""

    def hold(self) -> None:
        """End the present motion; the head stays where it is."""

    def look_at(self, point: Vector3, frame: str, *, max_velocity: float) -> object:
        """Turn to a point [m], at most at this speed [rad/s]; wait for the arrival."""


def calibrate_camera(
    head: TurningHead,
    camera: int | str | Iterable[tuple[float, Pixels]] = 0,
    *,
    target: str = "marker",
    marker: MarkerParameters | None = None,
    frame: str = "camera_optical_frame",
    model: Camera | None = None,
    focal_length: bool = False,
    report: Callable[[str], object] = lambda text: None,
) -> Calibration:
    """Measure the pose of the camera of a head; see `Head.calibrate`."""
    try:
        import scipy  # noqa: F401
    except ImportError:
        raise CalibrationError(
            Reason.NOT_INSTALLED,
            "SciPy is needed: pip install 'head_tracking[vision]', or apt install python3-scipy",
        ) from None
    check_kind(marker, MarkerParameters)
    check_kind(model, Camera)
    observe = observer(target, marker)
    robot = head.frames.model
    assert robot is not None
    pan, tilt = head.joints
    geometry = HeadGeometry(robot, pan, tilt, frame)
    source = checked_pictures(camera)
    _, first = next(source, (0.0, None))
    if first is None:
        raise _no_picture()
    height, width = first.shape[:2]
    lens = model or camera_with_view(width, height, DEFAULT_VIEW)
    if (lens.width, lens.height) != (width, height):
        raise ValueError(
            f"the images are {width} x {height}; the camera's model is for {lens.width} x "
            f"{lens.height}"
        )
    head.hold()
    sought = what_to_show(target, marker)
    gathering = _Gathering(head, geometry, source, lens, observe, sought, TARGETS[target])
    views = gathering.all_views(report)
    report(f"{len(views)} views; computing")
    size = marker.marker_size if marker and target == "marker" else None
    return solve(geometry, lens, views, size, focal_length=focal_length)


class _Gathering:
    """Records views of a target that does not move.

    Args:
        head: the head.
        geometry: geometry of the head.
        source: images with their times [s].
        camera: the camera.
        observe: finds the target in an image.
        sought: what it finds, as text.
        still: maximum motion between two images of a still target [px].
    """

    def __init__(
        self,
        head: TurningHead,
        geometry: HeadGeometry,
        source: Iterator[tuple[float, Pixels]],
        camera: Camera,
        observe: Observe,
        sought: str,
        still: float,
    ) -> None:
        self._head, self._geometry, self._source, self._camera = head, geometry, source, camera
        self._observe, self._sought, self._still = observe, sought, still
        self._positions = tuple(head.joints.values())
        self._behind, self._directions, self._noted = [*self._positions], [0, 0], 0

    def all_views(self, report: Callable[[str], object]) -> list[View]:
        """Return views with the target at positions all over the image, in random order.

        Random order distinguishes a motion of the target or the camera from a wrong mounting.
        """
        end = time.monotonic() + LONGEST
        views = self._views()
        if not views:
            raise CalibrationError(
                Reason.FEW_VIEWS,
                f"the camera does not see {self._sought} at rest: turn the head to it, use more "
                "light, move neither by hand, and check that the image is sharp and not mirrored",
            )
        middle = (self._camera.cx, self._camera.cy)
        nearest = min(views, key=lambda view: math.dist(view.corners.mean(axis=0), middle))
        points = self._points(nearest)[: MOST_VIEWS - 1]
        for number, point in enumerate(points, 1):
            if time.monotonic() > end:
                break
            report(f"direction {number} of {len(points)}; views: {len(views)}")
            if self._turn(point, end):
                views += self._views()
        return views

    def _turn(self, point: Vector3, end: float) -> bool:
        """Turn to a point in the base of the head [m]; return whether it is reachable.

        While the joints are not measured, it is repeated until `end` [s, as time.monotonic()].
        """
        while True:
            try:
                self._head.look_at(point, self._geometry.base, max_velocity=_SPEED)
            except UnreachableError:
                return False
            except SupersededError as error:
                raise CalibrationError(
                    Reason.MOVED,
                    "another command has turned the head: send it none, do not calibrate it twice "
                    "at once, and calibrate again",
                ) from error
            except FrameError:
                if time.monotonic() > end:
                    raise
                time.sleep(_RETRY)
            else:
                return True

    def _points(self, seen: View) -> list[Vector3]:
        """Return points to look at, in the base of the head [m].

        The target moves from one side of the image to the other, as far as the joints' limits
        allow.
        """
        geometry, camera = self._geometry, self._camera
        head = PanTiltHead(
            geometry.model, geometry.pan.name, geometry.tilt.name, geometry.optical_frame, AHEAD
        )
        u, v = seen.corners.mean(axis=0).tolist()
        x, y = camera.ray((u, v))
        across = _REACH * camera.width / 2.0 / camera.fx
        down = _REACH * camera.height / 2.0 / camera.fy
        sides = [
            head.gaze(self._seen_at(seen, x - right, y - below), seen.pan, seen.tilt)
            for right, below in ((-across, 0.0), (across, 0.0), (0.0, -down), (0.0, down))
        ]
        ranges = np.array(
            [
                _range([gaze.pan for gaze in sides], head.pan_limits),
                _range([gaze.tilt for gaze in sides], head.tilt_limits),
            ]
        )
        first, extent = ranges[:, 0], np.ptp(ranges, axis=1)
        # a position is never the same twice: its reading would err alike
        scatter, rng = np.minimum(_STOOD, extent), np.random.default_rng(1)
        steps = _steps(rng)
        positions = first + steps * (extent - scatter) + scatter * rng.random(steps.shape)
        turns, places = geometry.cameras(_NO_ERRORS, *positions.T)
        points = places + _DISTANCE * turns[:, :, 2]
        return [(x, y, z) for x, y, z in points.tolist()]

    def _seen_at(self, view: View, x: float, y: float) -> Vector3:
        """Return a point that the camera of a view sees at x and y, in the base [m]."""
        pan, tilt = np.array([view.pan]), np.array([view.tilt])
        (turn,), (place,) = self._geometry.cameras(_NO_ERRORS, pan, tilt)
        x, y, z = (place + turn @ (_DISTANCE * np.array((x, y, 1.0)))).tolist()
        return x, y, z

    def _views(self) -> list[View]:
        """Return what is visible as soon as head and image are still; empty: nothing.

        The joints must be at rest from a measurement before the images to one after them, because
        measurements and the start of a motion may be late.
        """
        self._note_motion()
        arrived = self._measured()
        end = arrived + _SETTLING + _PATIENCE
        deadline = time.monotonic() + _LONGEST_STOP
        before: dict[int, View] = {}
        compared = 0
        for stamped, picture in self._source:
            if time.monotonic() > deadline:
                return []
            stamp = min(stamped, time.time())  # the clock of the camera may be ahead
            if stamp < arrived - _OLDEST:
                raise ValueError(
                    f"the time of an image is {stamped}, the joints were measured at {arrived}; "
                    "give the time at which it was taken, as time.time() does"
                )
            if stamp < arrived + _SETTLING:
                continue
            self._wait_for_joints(stamp)
            if self._note_motion():
                arrived, compared, found = self._measured(), 0, {}
            else:
                compared, found = compared + 1, self._detect(stamp, picture)
            still = [
                view
                for number, view in found.items()
                if number in before
                and np.abs((view.corners - before[number].corners).mean(axis=0)).max() < self._still
            ]
            if still or (stamp > end and compared >= _COMPARED):
                return still
            before = found
        raise _no_picture()

    def _detect(self, stamp: float, picture: Pixels) -> dict[int, View]:
        frame = Frame(round(stamp * 1e9), self._camera, Picture(picture))
        pan, tilt = self._head.joints.values()
        directions = self._directions[0], self._directions[1]
        return {
            number: View(pan, tilt, number, corners, directions)
            for number, corners in self._observe(frame).items()
        }

    def _measured(self) -> float:
        """Return the time of the latest joint measurement [s]."""
        found = map(self._head.frames.latest_joint_position, self._head.joints)
        return min((each[0] * 1e-9 for each in found if each is not None), default=-math.inf)

    def _wait_for_joints(self, stamp: float) -> None:
        """Wait for a joint measurement after an image."""
        end = time.monotonic() + _LATE
        while self._measured() < stamp and time.monotonic() < end:
            time.sleep(_POLL)

    def _note_motion(self) -> bool:
        """Return whether a joint has moved since the last call; store its direction.

        It is known if the joint has crossed the play, and not turned back since.
        """
        after, self._noted = self._noted, round(self._measured() * 1e9)  # before the positions
        positions, half = tuple(self._head.joints.values()), 0.5 * _CROSSED
        for joint, name in enumerate(self._head.joints):
            behind = self._behind[joint]
            path = self._head.frames.joint_positions(name, after)
            for position in (*path, positions[joint]):
                behind = min(max(behind, position - half), position + half)
            ahead, self._behind[joint] = positions[joint] - behind, behind
            is_known = abs(ahead) > half - _STOOD
            self._directions[joint] = round(math.copysign(is_known, ahead))
        if max(map(abs, np.subtract(positions, self._positions))) <= _STOOD:
            return False
        self._positions = positions
        return True


def _no_picture() -> CalibrationError:
    return CalibrationError(
        Reason.NO_PICTURE,
        "no image from the camera: check that it is connected and that no other program uses it, "
        "and calibrate again",
    )


def _steps(rng: np.random.Generator) -> Array:
    """Return pan and tilt of a grid from 0 to 1 in random order, shape (N, 2).

    Both change each time: a joint that does not turn stays at an unknown place in its play.
    """
    while True:
        left = rng.permutation(list(product(range(_STEPS), repeat=2))).tolist()
        order = [left.pop()]
        pan, tilt = order[0]
        while others := [step for step in left if step[0] != pan and step[1] != tilt]:
            pan, tilt = others[0]
            order.append(others[0])
            left.remove(others[0])
        if not left:
            return np.array(order) / (_STEPS - 1)


def _range(positions: Sequence[float], limits: JointLimits) -> tuple[float, float]:
    """Return the extremes of positions [rad], not at a limit.

    At a limit, a pointing frame that is beside the camera would be out of reach.
    """
    margin = min(_MARGIN, 0.25 * (limits.upper - limits.lower))
    lower, upper = limits.lower + margin, limits.upper - margin
    return max(min(positions), lower), min(max(positions), upper)
