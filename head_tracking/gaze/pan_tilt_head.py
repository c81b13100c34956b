"""Which joint positions put a camera's axis through a point.

Everything is computed in a frame called C: its origin lies on the pan axis, z points along the
pan axis, and at pan 0 and tilt 0, y points along the tilt axis as far as that is square to z. So
pan turns about z and tilt about y, whatever axes and signs the model has.

What tilt carries is given in the tilt basis: the unit vectors x of C, down, and the tilt axis n, so
that tilt turns the first of them towards the second.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from operator import mul
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from head_tracking.compatibility import StrEnum
from head_tracking.transforms import (
    Joint,
    JointLimits,
    JointType,
    RobotModel,
    RobotModelError,
    Rotation,
    Transform,
    Vector3,
)

Array = npt.NDArray[np.float64]

ON_LIMIT = 1e-3
"""A gaze that misses by less [rad] because of a joint limit still counts as reached."""

_CLOSE = 1e-3  # m: nearer than this to the pan axis or the camera, a bearing means nothing

_FAR = 1e9  # m: beyond this only the direction matters, and squares would overflow

_ALONG = 1e-3  # rad; a camera this near to the tilt axis looks along it

UNLIMITED = (-math.inf, math.inf)

_NEARLY_SQUARE = 0.01  # rad; heads built like this have one gaze, and no other comes near it

_WAY = 0.1  # rad beyond a limit that count as much as 1 rad of way

_STEP, _SMALLEST_STEP = 0.25, 1e-6  # rad

_SAME = 1e-15  # rad
_MOST_TURNS = 50  # of a loop that ends after 1 on a square head and after 4 on a nearly square one
_SIDES = 64  # where a head of another build is tried, all round


class GazeStatus(StrEnum):
    """Whether a point can be looked at, and if not, why."""

    REACHED = "reached"
    OUT_OF_REACH = "out of reach"
    ON_PAN_AXIS = "on the pan axis"
    TOO_CLOSE = "at the camera"
    NOT_FINITE = "not finite"


@dataclass(frozen=True, slots=True)
class Gaze:
    """Where to turn the head.

    Attributes:
        pan: position of the pan joint [rad], within its limits.
        tilt: position of the tilt joint [rad], within its limits.
        status: whether the point is reached, and if not, why.
        miss: angle between the pointing axis and the direction to the point [rad], 0 to pi.
        reason: a sentence on what is wrong; empty where the point is reached.
    """

    pan: float
    tilt: float
    status: GazeStatus
    miss: float
    reason: str = ""

    @property
    def reached(self) -> bool:
        """Whether the axis goes through the point."""
        return self.status is GazeStatus.REACHED

    def is_usable(self, *, clamp: bool) -> bool:
        """Return whether to turn there; `clamp`: also where the limits keep it from the point."""
        out_of_reach = self.status in (GazeStatus.OUT_OF_REACH, GazeStatus.ON_PAN_AXIS)
        return self.reached or (clamp and out_of_reach)


class Ray(NamedTuple):
    """A point as the head sees it, limits aside.

    Attributes:
        pan: position of the pan joint that looks at it [rad]; may count full turns.
        tilt: position of the tilt joint that looks at it [rad].
        distance: along the camera's axis, from where it passes the pan axis [m].
    """

    pan: float
    tilt: float
    distance: float


class PanTiltHead:
    """A pan joint that carries a tilt joint that carries a frame to point.

    Args:
        model: the robot.
        pan_joint: name of the joint that turns the head left and right.
        tilt_joint: name of the joint that turns it up and down.
        pointing_frame: the link to point, any that the two joints carry.
        pointing_axis: the direction in `pointing_frame` to point, shape (3,). By default z for
            a frame with "optical" in its name (REP 103), else x.
        pan_limits: narrows the model's limits of the pan joint, (lower, upper) [rad].
        tilt_limits: the same for the tilt joint.

    Raises:
        RobotModelError: the model has no such joints or link, they do not carry each other, or
            something else moves between them; or the limits leave nothing.

    Attributes:
        base_frame: the link that carries the pan joint. It stands still while the head turns;
            targets are given in it.
        pointing_axis: the direction in `pointing_frame` that is pointed, of length 1.
    """

    def __init__(
        self,
        model: RobotModel,
        pan_joint: str,
        tilt_joint: str,
        pointing_frame: str,
        pointing_axis: Sequence[float] | None = None,
        pan_limits: tuple[float, float] = UNLIMITED,
        tilt_limits: tuple[float, float] = UNLIMITED,
    ) -> None:
        pan, tilt = model.joint(pan_joint), model.joint(tilt_joint)
        if pan is tilt:
            raise RobotModelError(f"pan and tilt are both {pan_joint!r}; give two joints")
        self.pan_joint = pan_joint
        self.tilt_joint = tilt_joint
        self.pointing_frame = pointing_frame
        self.base_frame = pan.parent
        self.pan_limits = pan.limits.narrowed(*pan_limits, pan_joint)
        self.tilt_limits = tilt.limits.narrowed(*tilt_limits, tilt_joint)
        below_pan, below_tilt = _fixed_joints(model, pan, tilt, pointing_frame)
        self.pointing_axis = _pointing_axis(pointing_frame, pointing_axis)
        T_pan_tilt = _product(below_pan) @ tilt.origin
        T_tilt_camera = _product(below_tilt)
        tilt_axis = T_pan_tilt.rotation @ tilt.axis
        R_C_pan = _canonical(pan, tilt, tilt_axis)
        R_C_tilt = R_C_pan @ T_pan_tilt.rotation
        self._T_C_base = Transform((0.0, 0.0, 0.0), R_C_pan) @ pan.origin.inverse()
        self._T_base_C = self._T_C_base.inverse()
        # y and z of the tilt axis in C: (1, 0) on nearly every head; x is 0 by the choice of C
        _, ny, nz = R_C_pan @ tilt_axis
        self._slant = slant = (1.0, 0.0) if abs(nz) < _SAME else (ny, nz)
        self._tilt_origin = R_C_pan @ T_pan_tilt.translation  # at pan 0, in C [m]
        # in the tilt basis: from the tilt origin [m], and of length 1
        self._camera = _in_tilt_basis(R_C_tilt @ T_tilt_camera.translation, slant)
        axis = R_C_tilt @ (T_tilt_camera.rotation @ self.pointing_axis)
        self._axis = _in_tilt_basis(axis, slant)
        if math.hypot(*self._axis[:2]) < _ALONG:
            raise RobotModelError(
                f"{pointing_frame!r} looks along the axis of {tilt_joint!r}, which cannot turn it "
                "elsewhere; choose another pointing_frame or pointing_axis"
            )
        # how far before the tilt origin the camera is, along its axis, and before the pan axis [m]
        self._ahead = math.fsum(map(mul, self._camera, self._axis))
        self._lead = self._tilt_origin[0] + self._ahead
        self._beside_axis = math.hypot(*np.cross(self._camera, self._axis))
        self._nearly_square = abs(slant[1]) < _NEARLY_SQUARE and abs(self._axis[2]) < _NEARLY_SQUARE

    @property
    def axes(self) -> Rotation:
        """The rotation from `base_frame` to C."""
        return self._T_C_base.rotation

    def gaze(self, target: Sequence[float], pan: float, tilt: float) -> Gaze:
        """Return the joint positions that look at `target`, or come nearest to it.

        Does not raise: a point that cannot be reached has a status, a reason and a miss.

        Args:
            target: the point, shape (3,) [m], in `base_frame`.
            pan: present position of the pan joint [rad]. Of several solutions the nearest is
                taken, and it stays where the target leaves it free.
            tilt: present position of the tilt joint [rad].
        """
        pan, tilt = self.pan_limits.clamp(pan), self.tilt_limits.clamp(tilt)
        if not all(map(math.isfinite, target)):
            reason = f"the target {tuple(target)} is not finite"
            return Gaze(pan, tilt, GazeStatus.NOT_FINITE, math.pi, reason)
        point = self._point(target)
        on_axis = math.hypot(point[0], point[1]) < _CLOSE
        solutions = []
        for solution in self._solutions(point, pan, tilt, on_axis=on_axis):
            solutions.append(solution)
            if self._allowed(solution):
                nearest = wanted = solution
                break
        else:
            inside = {
                self._inside(point, solution, (pan, tilt)): solution for solution in solutions
            }
            if not inside:
                reason = "no turn of the head brings the target before the camera: too close?"
                miss = self._miss(point, pan, tilt)
                return Gaze(pan, tilt, GazeStatus.TOO_CLOSE, miss, reason)
            nearest = min(inside, key=lambda positions: self._miss(point, *positions))
            wanted = inside[nearest]
        miss = self._miss(point, *nearest)
        if miss < ON_LIMIT:
            return Gaze(*nearest, GazeStatus.REACHED, miss)
        if on_axis:
            reason = "the target is on the pan axis: every pan looks at it alike"
            return Gaze(*nearest, GazeStatus.ON_PAN_AXIS, miss, reason)
        return Gaze(*nearest, GazeStatus.OUT_OF_REACH, miss, self._out_of_reach(wanted, miss))

    def ray(self, target: Sequence[float], pan: float, tilt: float) -> Ray | None:
        """Return the ray to a point, limits aside; None if no turn brings it before the camera.

        How far away a point on the camera's axis is makes no difference to pan and tilt.

        Args:
            target: the point, shape (3,) [m], in `base_frame`, finite.
            pan: of all turns that look there, the one nearest to this is taken [rad].
            tilt: the same for tilt [rad].
        """
        point = self._point(target)
        on_axis = math.hypot(point[0], point[1]) < _CLOSE
        direction = pan if on_axis else self._pan_to(point, backwards=False)
        angle = None if direction is None else self._tilt_to(point, direction)
        if direction is None or angle is None:
            return None
        return Ray(
            pan + math.remainder(direction - pan, math.tau),
            tilt + math.remainder(angle - tilt, math.tau),
            max(math.hypot(*self._seen(point, direction, angle)) + self._lead, _CLOSE),
        )

    def gaze_along(self, ray: Ray, pan: float, tilt: float) -> Gaze:
        """Return the gaze at a point, given by its ray; see `gaze`."""
        positions = (
            turn_near(ray.pan, pan, self.pan_limits),
            turn_near(ray.tilt, tilt, self.tilt_limits),
        )
        if self._allowed(positions):
            return Gaze(*positions, GazeStatus.REACHED, 0.0)
        return self.gaze(self.point(ray), pan, tilt)

    def point(self, ray: Ray) -> Vector3:
        """Return the point of a ray, shape (3,) [m], in `base_frame`."""
        pan, tilt, distance = ray
        distance = max(distance - self._lead, _CLOSE)
        u, v, w = self._axis
        return self.placed_in_base((distance * u, distance * v, distance * w), pan, tilt)

    def seen(self, target: Sequence[float], pan: float, tilt: float) -> Vector3:
        """Return a point of `base_frame` as seen from the camera at these joint positions.

        Args:
            target: the point, shape (3,) [m], in `base_frame`.
            pan: position of the pan joint [rad].
            tilt: position of the tilt joint [rad].

        Returns:
            The point, shape (3,) [m], in axes fixed to the camera; `placed` takes it back.
        """
        return self._seen(self._point(target), pan, tilt)

    def placed(self, seen: Vector3, pan: Array, tilt: Array) -> tuple[Array, Array, Array]:
        """Return where a point that the camera sees is, for each of N joint positions.

        Args:
            seen: the point as seen from the camera, shape (3,) [m]; see `seen`.
            pan: positions of the pan joint, shape (N,) [rad].
            tilt: positions of the tilt joint, shape (N,) [rad].

        Returns:
            x, y, z [m], shape (N,) each, along the axes of C, from a point on the pan axis.
        """
        u, v, w = (a + b for a, b in zip(seen, self._camera, strict=True))
        cosine, sine = np.cos(tilt), np.sin(tilt)
        (ny, nz), (ox, oy, oz) = self._slant, self._tilt_origin
        down = cosine * v + sine * u
        x = cosine * u - sine * v + ox
        y = nz * down + (ny * w + oy)
        cosine, sine = np.cos(pan), np.sin(pan)
        return cosine * x - sine * y, cosine * y + sine * x, (nz * w + oz) - ny * down

    def placed_in_base(self, seen: Vector3, pan: float, tilt: float) -> Vector3:
        """Return the point of `base_frame` [m] that is seen like this; the inverse of `seen`."""
        (u, v, w), (cu, cv, cw) = seen, self._camera
        x, v, w = _turned((cu + u, cv + v, cw + w), -tilt)
        (ny, nz), (ox, oy, oz) = self._slant, self._tilt_origin
        point = _turned((x + ox, nz * v + ny * w + oy, nz * w - ny * v + oz), -pan)
        return self._T_base_C.apply(point)

    def miss(self, target: Sequence[float], pan: float, tilt: float) -> float:
        """Return the angle [rad], 0 to pi, between the axis and the direction to a point.

        Args:
            target: the point, shape (3,) [m], in `base_frame`.
            pan: position of the pan joint [rad].
            tilt: position of the tilt joint [rad].
        """
        return self._miss(self._point(target), pan, tilt)

    def _point(self, target: Sequence[float]) -> Vector3:
        farthest = max(map(abs, target))
        if farthest > _FAR:
            target = [coordinate / farthest * _FAR for coordinate in target]
        return self._T_C_base.apply(target)

    def _solutions(
        self, point: Vector3, pan: float, tilt: float, *, on_axis: bool
    ) -> Iterator[tuple[float, float]]:
        """Yield all turns that point the axis at the point: ahead first, then backwards.

        On a head of another build than usual, others follow; if there are none, what comes nearest.
        """
        pans: Iterable[float | None] = (
            [pan] if on_axis else (self._pan_to(point, backwards=side) for side in (False, True))
        )
        if not (on_axis or self._nearly_square):
            pans = chain(pans, self._pans(point))
        for direction in pans:
            angle = None if direction is None else self._tilt(point, direction, tilt)
            if direction is not None and angle is not None:
                yield turn_near(direction, pan, self.pan_limits), angle

    def _tilt(self, point: Vector3, pan: float, tilt: float) -> float | None:
        angle = self._tilt_to(point, pan)
        return None if angle is None else turn_near(angle, tilt, self.tilt_limits)

    def _allowed(self, positions: tuple[float, float]) -> bool:
        return self.pan_limits.contains(positions[0]) and self.tilt_limits.contains(positions[1])

    def _inside(
        self, point: Vector3, wanted: tuple[float, float], present: tuple[float, float]
    ) -> tuple[float, float]:
        """Return the allowed positions nearest to `wanted`: pan first, then the best tilt there.

        On a head of another build than usual these may be far from the best: it is searched there,
        and may be full turns away from `present`.
        """
        pan, tilt = self.pan_limits.clamp(wanted[0]), wanted[1]
        if pan != wanted[0]:
            beside = self._tilt(point, pan, tilt)
            tilt = tilt if beside is None else beside
        best = pan, self.tilt_limits.clamp(tilt)
        if self._nearly_square:
            return best
        least, step = self._miss(point, *best), _STEP
        while step > _SMALLEST_STEP:
            pan, tilt = best
            sides = [(self.pan_limits.clamp(pan + side), tilt) for side in (step, -step)]
            sides += [(pan, self.tilt_limits.clamp(tilt + side)) for side in (step, -step)]
            miss, side = min((self._miss(point, *side), side) for side in sides)
            if miss < least:
                least, best = miss, side
            else:
                step *= 0.5
        pan, tilt = map(turn_near, best, present, (self.pan_limits, self.tilt_limits))
        return self.pan_limits.clamp(pan), self.tilt_limits.clamp(tilt)

    def _out_of_reach(self, wanted: tuple[float, float], miss: float) -> str:
        needs = [
            f"{name} {position:.3g} rad (allowed {limits.lower:.3g} to {limits.upper:.3g})"
            for name, position, limits in (
                (self.pan_joint, wanted[0], self.pan_limits),
                (self.tilt_joint, wanted[1], self.tilt_limits),
            )
            if not limits.contains(position)
        ]
        cause = f"it needs {' and '.join(needs)}; " if needs else ""
        return (
            f"the target is out of reach: {cause}"
            f"the nearest gaze would miss it by {math.degrees(miss):.1f} degrees"
        )

    def _pan_to(self, point: Vector3, *, backwards: bool) -> float | None:
        """Return the pan [rad] with which the axis can go through a point of C.

        The pointing axis keeps its height w over the plane that is square to the tilt axis, give
        or take its own slope: that fixes the y which the point must have in C as pan carries it.
        The slope, 0 on a square head, needs the range of the point, which hardly depends on pan.

        Args:
            point: shape (3,) [m], not on the pan axis.
            backwards: the head turns its back on the point and looks over its shoulder. A head
                whose tilt axis points to its right looks along -x of C at tilt 0.

        Returns:
            None if no pan will do.
        """
        x, y, z = point
        rho, bearing = math.hypot(x, y), math.atan2(y, x)
        ny, nz = self._slant
        slope = self._axis[2] / ny
        aside = self._tilt_origin[1] + (self._camera[2] - nz * (z - self._tilt_origin[2])) / ny
        reach = math.hypot(rho, z)
        for _ in range(_MOST_TURNS):
            side = aside + slope * reach
            offset = math.asin(min(max(side / rho, -1.0), 1.0))
            behind = backwards is not (self._axis[0] < 0.0)
            pan = bearing - math.pi + offset if behind else bearing - offset
            if slope == 0.0:
                return pan if abs(side) < rho else None
            # as far from the tilt origin as the point, which pan changes little
            inside = math.hypot(*self._beside(point, pan)) ** 2 - self._beside_axis**2
            if inside <= 0.0:
                return None
            found = math.sqrt(inside) - self._ahead
            if abs(slope * (found - reach)) <= _SAME * rho:
                return pan if abs(side) < rho else None
            reach = found
        return None

    def _pans(self, point: Vector3) -> Iterator[float]:
        """Yield every pan [rad] with which the axis can go through a point, on a head of any build.

        If there is none, yield the one with which the axis passes it least aside.
        """
        sides = [math.tau * number / _SIDES for number in range(_SIDES + 1)]
        tried = [(side, self._aside(point, side)) for side in sides]
        found = False
        for (side, before), (_, after) in pairwise(tried):
            if before * after <= 0.0:
                found, pan, step = True, side, math.tau / _SIDES
                for _ in range(_MOST_TURNS):
                    step *= 0.5
                    if self._aside(point, pan + step) * before > 0.0:
                        pan += step
                yield pan
        asides = {abs(aside): side for side, aside in tried if not math.isnan(aside)}
        if asides and not found:
            yield asides[min(asides)]

    def _aside(self, point: Vector3, pan: float) -> float:
        """Return how far the axis passes a point of C, along the tilt axis [m]; nan: not at all."""
        u, v, w = self._beside(point, pan)
        reach = self._range(u, v)
        return math.nan if reach is None else w - self._camera[2] - reach * self._axis[2]

    def _tilt_to(self, point: Vector3, pan: float) -> float | None:
        """Return the tilt [rad] that brings the axis to a point of C, seen along the tilt axis.

        None if no tilt will do.
        """
        u, v, _ = self._beside(point, pan)
        reach = self._range(u, v)
        if reach is None or reach <= _CLOSE:
            return None
        (cu, cv, _), (au, av, _) = self._camera, self._axis
        return math.atan2(v, u) - math.atan2(cv + reach * av, cu + reach * au)

    def _miss(self, point: Vector3, pan: float, tilt: float) -> float:
        """Return the angle between the pointing axis and the direction to a point of C [rad]."""
        x, y, z = self._seen(point, pan, tilt)
        ax, ay, az = self._axis
        across = math.hypot(ay * z - az * y, az * x - ax * z, ax * y - ay * x)
        return math.atan2(across, ax * x + ay * y + az * z)

    def _beside(self, point: Vector3, pan: float) -> Vector3:
        """A point of C from the tilt axis, in the tilt basis at tilt 0 [m]."""
        x, y, z = _turned(point, pan)
        ox, oy, oz = self._tilt_origin
        return _in_tilt_basis((x - ox, y - oy, z - oz), self._slant)

    def _seen(self, point: Vector3, pan: float, tilt: float) -> Vector3:
        """A point of C from the camera, in the tilt basis as tilt carries it [m]."""
        u, v, w = _turned(self._beside(point, pan), tilt)
        cu, cv, cw = self._camera
        return u - cu, v - cv, w - cw

    def _range(self, u: float, v: float) -> float | None:
        """How far along the pointing axis [m] it is as far from the tilt axis as (u, v)."""
        (cu, cv, _), (au, av, _) = self._camera, self._axis
        square = au * au + av * av
        half = cu * au + cv * av
        # (across the axis, seen along tilt: better conditioned than the difference of squares)
        beside = (cu * av - cv * au) ** 2
        inside = square * (u * u + v * v) - beside
        return None if inside <= 0.0 else (math.sqrt(inside) - half) / square


def _turned(point: Vector3, angle: float) -> Vector3:
    """A point in a frame that is turned by an angle [rad] about z."""
    cosine, sine = math.cos(angle), math.sin(angle)
    x, y, z = point
    return cosine * x + sine * y, cosine * y - sine * x, z


def _in_tilt_basis(vector: Vector3, slant: tuple[float, float]) -> Vector3:
    (x, y, z), (ny, nz) = vector, slant
    return x, nz * y - ny * z, ny * y + nz * z


def turn_near(angle: float, present: float, limits: JointLimits) -> float:
    """Return the same direction plus full turns: allowed if possible, then near `present`.

    If none is allowed, the one least beyond the limits, and a longer way counts a little: a target
    behind the head that moves to and fro must not turn the head from one limit to the other.

    Args:
        angle: a direction [rad].
        present: where the joint stands [rad].
        limits: where it may go.
    """
    nearest = present + math.remainder(angle - present, math.tau)
    turns = (nearest, nearest - math.tau, nearest + math.tau)
    for turn in turns:
        if limits.contains(turn):
            return turn
    return min(turns, key=lambda t: abs(t - limits.clamp(t)) + _WAY * abs(t - present))


def _fixed_joints(
    model: RobotModel, pan: Joint, tilt: Joint, pointing_frame: str
) -> tuple[list[Joint], list[Joint]]:
    """Return the joints from pan to tilt, and from tilt to the pointing frame."""
    for joint in (pan, tilt):
        if joint.type not in (JointType.REVOLUTE, JointType.CONTINUOUS) or joint.mimic:
            raise RobotModelError(
                f"{joint.name!r} cannot turn the head: it must be revolute or continuous and "
                "mimic no other joint"
            )
    if pointing_frame not in model.links:
        raise RobotModelError(
            f"the model {model.name!r} has no link {pointing_frame!r} to point; "
            f"its links are: {', '.join(model.links)}"
        )
    above = model.joints_above(pointing_frame)
    if tilt not in above or pan not in above:
        carried = [link for link in model.links if {pan, tilt} <= set(model.joints_above(link))]
        raise RobotModelError(
            f"{pointing_frame!r} is not carried by {pan.name!r} and {tilt.name!r}; "
            f"frames that are: {', '.join(carried) or 'none'}"
        )
    if above.index(tilt) > above.index(pan):
        raise RobotModelError(
            f"{tilt.name!r} carries {pan.name!r}: exchange head_pan_joint and head_tilt_joint; the "
            "joint nearer to the base is head_pan_joint, also if it tilts the head"
        )
    below_tilt = above[: above.index(tilt)][::-1]
    below_pan = above[above.index(tilt) + 1 : above.index(pan)][::-1]
    for joint in (*below_pan, *below_tilt):
        if joint.moves:
            raise RobotModelError(
                f"the joint {joint.name!r} between {pan.name!r} and {pointing_frame!r} moves too; "
                "choose a pointing frame above it, or make it fixed"
            )
    return below_pan, below_tilt


def _product(joints: list[Joint]) -> Transform:
    product = Transform.identity()
    for joint in joints:
        product = product @ joint.origin
    return product


def _canonical(pan: Joint, tilt: Joint, tilt_axis: Vector3) -> Rotation:
    """`R_C_pan`, from the axes of pan and tilt in the pan joint's frame."""
    z = np.array(pan.axis)
    y = np.array(tilt_axis)
    y = y - (y @ z) * z
    if np.linalg.norm(y) < 1e-6:
        raise RobotModelError(
            f"{pan.name!r} and {tilt.name!r} turn about the same direction: "
            "together they can only point along a circle"
        )
    y /= np.linalg.norm(y)
    return Rotation.from_matrix(np.stack([np.cross(y, z), y, z]))


def _pointing_axis(frame: str, axis: Sequence[float] | None) -> Vector3:
    if axis is None:
        return (0.0, 0.0, 1.0) if "optical" in frame else (1.0, 0.0, 0.0)
    norm = math.hypot(*axis)
    if len(axis) != 3 or not 1e-9 < norm < math.inf:
        raise RobotModelError(
            f"the pointing axis {tuple(axis)} is no direction; give three numbers, not all 0"
        )
    return axis[0] / norm, axis[1] / norm, axis[2] / norm
