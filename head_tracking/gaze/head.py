"""Which joint positions put a camera's axis through a point."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from head_tracking.gaze.geometry import HeadGeometry, turned
from head_tracking.gaze.newton import refine
from head_tracking.transforms import JointLimits, RobotModel, RobotModelError, Vector3

ON_LIMIT = 1e-3
"""A gaze that misses by less [rad] because of a joint limit still counts as reached."""

_CLOSE = 1e-3  # m: nearer than this to the pan axis or the camera, a bearing means nothing

_FAR = 1e9  # m: beyond this only the direction matters, and squares would overflow

_UNLIMITED = (-math.inf, math.inf)
_FREE = JointLimits()


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


class Sight(NamedTuple):
    """A point as the head sees it, limits aside.

    Attributes:
        pan: position of the pan joint that looks at it [rad]; may count full turns.
        tilt: position of the tilt joint that looks at it [rad].
        distance: from the camera [m].
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
    """

    def __init__(
        self,
        model: RobotModel,
        pan_joint: str,
        tilt_joint: str,
        pointing_frame: str,
        pointing_axis: Sequence[float] | None = None,
        pan_limits: tuple[float, float] = _UNLIMITED,
        tilt_limits: tuple[float, float] = _UNLIMITED,
    ) -> None:
        pan, tilt = model.joint(pan_joint), model.joint(tilt_joint)
        self.pan_joint = pan_joint
        self.tilt_joint = tilt_joint
        self.pointing_frame = pointing_frame
        self.base_frame = pan.parent
        try:
            self.pan_limits = pan.limits.narrowed(*pan_limits)
            self.tilt_limits = tilt.limits.narrowed(*tilt_limits)
        except ValueError as error:
            raise RobotModelError(f"{pan_joint}, {tilt_joint}: {error}") from error
        self._geometry = HeadGeometry.from_model(model, pan, tilt, pointing_frame, pointing_axis)
        # the camera as it stands when it looks level, seen from the side
        axis, camera = self._geometry.axis, self._geometry.camera
        self._level = math.atan2(-axis[2], axis[0])
        cosine, sine = math.cos(self._level), math.sin(self._level)
        self._forward = cosine * camera[0] - sine * camera[2]
        self._above = sine * camera[0] + cosine * camera[2]

    def gaze(self, target: Sequence[float], pan: float, tilt: float) -> Gaze:
        """The joint positions that look at `target`, or come nearest to it.

        Never raises: what can't be reached is answered with the reason and the miss.

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
        if on_axis:
            angle = self._side_view(point, pan, tilt)
            wanted = None if angle is None else (pan, angle)
        else:
            wanted = self._aim(point, pan, tilt)
        if not self._geometry.square and not on_axis:
            nearest = self._best_of(point, (wanted, (pan, tilt)))
            wanted = wanted or nearest
        elif wanted is None:
            reason = "the target is too close: no turn of the head brings it before the camera"
            miss = self._geometry.miss(point, pan, tilt)
            return Gaze(pan, tilt, GazeStatus.TOO_CLOSE, miss, reason)
        else:
            nearest = self._inside(point, wanted)
        miss = self._geometry.miss(point, *nearest)
        if on_axis:
            reason = "the target is on the pan axis: every pan looks at it alike"
            return Gaze(*nearest, GazeStatus.ON_PAN_AXIS, miss, reason)
        if miss < ON_LIMIT:
            return Gaze(*nearest, GazeStatus.REACHED, miss)
        return Gaze(*nearest, GazeStatus.OUT_OF_REACH, miss, self._out_of_reach(wanted, miss))

    def sight(self, target: Sequence[float], pan: float, tilt: float) -> Sight | None:
        """The point as seen from the head, limits aside; None if no turn brings it before the camera.

        Its pan and tilt do not depend on how far away a point on the camera's axis is.

        Args:
            target: the point, shape (3,) [m], in `base_frame`, finite.
            pan: of all turns that look there the one nearest to this is taken [rad].
            tilt: the same for tilt [rad].
        """
        point = self._point(target)
        x, y, z = point
        rho = math.hypot(x, y)
        side = self._geometry.tilt_origin[1] + self._geometry.camera[1]
        if rho <= max(abs(side), _CLOSE):
            return None
        bearing = math.atan2(y, x) - math.asin(side / rho)
        angle = self._side_view(point, bearing, tilt)
        if angle is None:
            return None
        bearing = pan + math.remainder(bearing - pan, math.tau)
        angle = tilt + math.remainder(angle - tilt, math.tau)
        if not self._geometry.square:
            bearing, angle = refine(self._geometry, point, (bearing, angle), (_FREE, _FREE))
        return Sight(bearing, angle, math.hypot(*self._geometry.seen(point, bearing, angle)))

    def look(self, sight: Sight, pan: float, tilt: float) -> Gaze:
        """The gaze at a point that is seen like this; see `gaze`."""
        turned_pan = turn_near(sight.pan, pan, self.pan_limits)
        turned_tilt = turn_near(sight.tilt, tilt, self.tilt_limits)
        if self.pan_limits.contains(turned_pan) and self.tilt_limits.contains(turned_tilt):
            return Gaze(turned_pan, turned_tilt, GazeStatus.REACHED, 0.0)
        return self.gaze(self.point(sight), pan, tilt)

    def point(self, sight: Sight) -> Vector3:
        """The point, shape (3,) [m], in `base_frame`, that is seen like this."""
        return self._geometry.ahead(*sight)

    def miss(self, target: Sequence[float], pan: float, tilt: float) -> float:
        """The angle [rad], 0 to pi, by which the axis misses a point.

        Args:
            target: the point, shape (3,) [m], in `base_frame`.
            pan: position of the pan joint [rad].
            tilt: position of the tilt joint [rad].
        """
        return self._geometry.miss(self._point(target), pan, tilt)

    def _point(self, target: Sequence[float]) -> Vector3:
        farthest = max(map(abs, target))
        if farthest > _FAR:
            target = [coordinate / farthest * _FAR for coordinate in target]
        return self._geometry.T_C_base.apply(target)

    def _aim(self, point: Vector3, pan: float, tilt: float) -> tuple[float, float] | None:
        """The closed form, limits aside; of the two ways round the first that is allowed."""
        x, y, _ = point
        rho = math.hypot(x, y)
        side = self._geometry.tilt_origin[1] + self._geometry.camera[1]
        if rho <= abs(side):
            return None
        bearing, offset = math.atan2(y, x), math.asin(side / rho)
        first = None
        for candidate in (bearing - offset, bearing - math.pi + offset):
            angle = self._side_view(point, candidate, tilt)
            if angle is None:
                continue
            solution = turn_near(candidate, pan, self.pan_limits), angle
            if self.pan_limits.contains(solution[0]) and self.tilt_limits.contains(angle):
                return solution
            first = first or solution
        return first

    def _side_view(self, point: Vector3, pan: float, tilt: float) -> float | None:
        """The tilt that brings the point to the height of the axis, seen from the side."""
        x, _, z = turned(point, pan)
        u, w = x - self._geometry.tilt_origin[0], z - self._geometry.tilt_origin[2]
        r = math.hypot(u, w)
        if r <= abs(self._above) or math.sqrt(r * r - self._above**2) <= self._forward + _CLOSE:
            return None
        angle = math.asin(self._above / r) - math.atan2(w, u) - self._level
        return turn_near(angle, tilt, self.tilt_limits)

    def _inside(self, point: Vector3, wanted: tuple[float, float]) -> tuple[float, float]:
        """The allowed positions nearest to those wanted: pan first, then the best tilt there."""
        pan, tilt = self.pan_limits.clamp(wanted[0]), wanted[1]
        if pan != wanted[0]:
            beside = self._side_view(point, pan, tilt)
            tilt = tilt if beside is None else beside
        return pan, self.tilt_limits.clamp(tilt)

    def _best_of(
        self, point: Vector3, starts: Sequence[tuple[float, float] | None]
    ) -> tuple[float, float]:
        limits = (self.pan_limits, self.tilt_limits)
        refined = [refine(self._geometry, point, start, limits) for start in starts if start]
        return min(refined, key=lambda positions: self._geometry.miss(point, *positions))

    def _out_of_reach(self, wanted: tuple[float, float], miss: float) -> str:
        needs = [
            f"{name} {position:.2f} rad (allowed {limits.lower:.2f} to {limits.upper:.2f})"
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


def turn_near(angle: float, present: float, limits: JointLimits) -> float:
    """The same direction, give or take full turns: allowed if possible, then near `present`.

    Args:
        angle: a direction [rad].
        present: where the joint stands [rad].
        limits: where it may go.
    """
    nearest = present + math.remainder(angle - present, math.tau)
    for turn in (nearest, nearest - math.tau, nearest + math.tau):
        if limits.contains(turn):
            return turn
    return nearest
