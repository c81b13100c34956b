"""Joint trajectories: waypoints in time, what lies between them, and whether the joints keep to it.

Interpolation, tolerances and result codes are those of ros2_control's joint_trajectory_controller
and of control_msgs/action/FollowJointTrajectory.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from head_tracking.parameters import parameter
from head_tracking.transforms import JointLimits

_BESIDE = 1e-3  # rad; a waypoint so little beyond a limit is one on it: planners round


class TrajectoryCode(IntEnum):
    """How a trajectory ended; FollowJointTrajectory's `error_code`."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    INVALID_JOINTS = -2
    OLD_HEADER_TIMESTAMP = -3
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5


class TrajectoryError(ValueError):
    """A trajectory that cannot be followed; the message says why.

    Attributes:
        code: what kind of mistake it is.
    """

    def __init__(self, code: TrajectoryCode, reason: str) -> None:
        super().__init__(reason)
        self.code = code


@dataclass(frozen=True, slots=True)
class TrajectoryParameters:
    """What a trajectory must keep to, where it does not say so itself."""

    path_tolerance: float = parameter(
        0.0,
        "A joint that is farther from a trajectory ends it; 0: that is not looked at.",
        unit="rad",
        minimum=0.0,
        maximum=6.3,
    )
    goal_tolerance: float = parameter(
        0.02,
        "A trajectory has succeeded when each joint is so near its end.",
        unit="rad",
        minimum=0.001,
        maximum=6.3,
    )
    goal_time_tolerance: float = parameter(
        1.0,
        "How late a trajectory may succeed.",
        unit="s",
        minimum=0.0,
        maximum=60.0,
    )


class Waypoint(NamedTuple):
    """Where joints are meant to be at one time.

    Attributes:
        time: from the start [s].
        positions: of each joint [rad].
        velocities: of each joint [rad/s]; empty: not said.
        accelerations: of each joint [rad/s^2]; empty: not said.
    """

    time: float
    positions: tuple[float, ...]
    velocities: tuple[float, ...] = ()
    accelerations: tuple[float, ...] = ()


class JointPoint(NamedTuple):
    """Where one joint is meant to be, and how it is meant to move.

    Attributes:
        position: [rad].
        velocity: [rad/s]; None: not said.
        acceleration: [rad/s^2]; None: not said.
    """

    position: float
    velocity: float | None = 0.0
    acceleration: float | None = 0.0


class Tolerances(NamedTuple):
    """How far joints may be from a trajectory; inf: as far as they like.

    Attributes:
        path: of each joint on the way [rad].
        goal: of each joint at the end [rad].
        goal_time: how late that may be [s].
    """

    path: Mapping[str, float]
    goal: Mapping[str, float]
    goal_time: float


class TrajectoryResult(NamedTuple):
    """How a trajectory ended, by the measured joints.

    Attributes:
        code: as FollowJointTrajectory has it.
        text: for a person.
    """

    code: TrajectoryCode
    text: str


def checked_waypoints(
    joints: Sequence[str], waypoints: Sequence[Waypoint], limits: Mapping[str, JointLimits]
) -> None:
    """Refuses what cannot be followed.

    Args:
        joints: those that the trajectory names.
        waypoints: one at least.
        limits: of the joints that there are.

    Raises:
        TrajectoryError: says what is wrong, and what is allowed.
    """
    known = ", ".join(limits)
    unknown = [joint for joint in joints if joint not in limits]
    if unknown or not joints:
        raise TrajectoryError(
            TrajectoryCode.INVALID_JOINTS,
            f"{', '.join(map(repr, unknown)) or 'no joint'} is none of this head's joints; "
            f"name {known}, or one of them",
        )
    if len(set(joints)) < len(joints):
        raise TrajectoryError(
            TrajectoryCode.INVALID_JOINTS, f"{', '.join(joints)}: name each joint once"
        )
    before = -math.inf
    for number, point in enumerate(waypoints, 1):
        where = f"point {number} of {len(waypoints)}"
        if not before < point.time or not 0.0 <= point.time < math.inf:
            raise TrajectoryError(
                TrajectoryCode.INVALID_GOAL,
                f"{where} has time_from_start {point.time:.3f} s; the first must not be negative, "
                "and each must be later than the one before",
            )
        before = point.time
        for what, values, may_lack in (
            ("positions", point.positions, False),
            ("velocities", point.velocities, True),
            ("accelerations", point.accelerations, True),
        ):
            if len(values) != len(joints) and not (may_lack and not values):
                raise TrajectoryError(
                    TrajectoryCode.INVALID_GOAL,
                    f"{where} has {len(values)} {what} for {len(joints)} joints; give one each"
                    + (", or none at all" if may_lack else ""),
                )
            if not all(map(math.isfinite, values)):
                raise TrajectoryError(
                    TrajectoryCode.INVALID_GOAL, f"{where}: {what} {list(values)} are not finite"
                )
        for joint, position in zip(joints, point.positions, strict=True):
            if not limits[joint].contains(position, _BESIDE):
                raise TrajectoryError(
                    TrajectoryCode.INVALID_GOAL,
                    f"{where} takes {joint} to {position:.3f} rad; allowed are "
                    f"{limits[joint].lower:.3f} to {limits[joint].upper:.3f}",
                )


class JointTrajectory:
    """A trajectory of all joints of a head, from where they are meant to be now.

    Joints that it does not name stay there. Waypoints that are over are left out, and the way to
    the first of the others begins now, or at `start` if that is later.

    Args:
        names: the joints that the waypoints are for.
        waypoints: see `checked_waypoints`; none: everything stays where it is.
        start: what their times count from [s].
        now: the time [s].
        present: where each joint of the head is meant to be now, and how it moves.
        limits: of each joint of the head; never left between waypoints either.
        tolerances: of the joints that it names.

    Raises:
        TrajectoryError: all of it is over.

    Attributes:
        joints: all of the head.
        end: the time of the last waypoint [s].
    """

    def __init__(
        self,
        names: Sequence[str],
        waypoints: Sequence[Waypoint],
        start: float,
        now: float,
        present: Mapping[str, JointPoint],
        limits: Mapping[str, JointLimits],
        tolerances: Tolerances,
    ) -> None:
        self.joints = tuple(present)
        self.end = max(start + waypoints[-1].time, now) if waypoints else now
        if waypoints and start + waypoints[-1].time < now:
            raise TrajectoryError(
                TrajectoryCode.OLD_HEADER_TIMESTAMP,
                f"it ended {now - start - waypoints[-1].time:.2f} s ago, by its header.stamp; a "
                "stamp of 0 starts it at once (or the clocks of its sender and of this machine "
                "differ)",
            )
        self._names = tuple(names)
        self._limits = limits
        self._tolerances = tolerances
        # what is no later than the beginning is where the joints are at once
        ahead = [point for point in waypoints if start + point.time > now] or waypoints[-1:]
        self._knots: dict[str, tuple[list[float], list[JointPoint]]] = {}
        for joint, here in present.items():
            times, points = [now], [here]
            if joint in names:
                index = self._names.index(joint)
                if start > now and ahead:
                    times.append(start)
                    points.append(JointPoint(here.position))
                for waypoint in ahead:
                    point = _of(waypoint, index)
                    if start + waypoint.time > times[-1]:
                        times.append(start + waypoint.time)
                        points.append(point)
                    else:
                        points[-1] = point
            self._knots[joint] = times, points

    def at(self, time: float) -> tuple[JointPoint, ...]:
        """Where each joint is meant to be at a time [s], within its limits."""
        found = []
        for joint, (times, points) in self._knots.items():
            after = bisect_right(times, time)
            if after == 0:
                point = JointPoint(points[0].position)
            elif after == len(times):
                point = JointPoint(points[-1].position)
            else:
                begin, end = times[after - 1], times[after]
                point = _between(points[after - 1], points[after], end - begin, time - begin)
            found.append(point._replace(position=self._limits[joint].clamp(point.position)))
        return tuple(found)

    def judge(self, stamp: float, measured: Sequence[float], now: float) -> TrajectoryResult | None:
        """How it ended; None as long as it is under way.

        Args:
            stamp: when the joints were measured [s].
            measured: each of them [rad].
            now: the time [s].
        """
        meant = self.at(stamp)
        off = {
            joint: position - point.position
            for joint, position, point in zip(self.joints, measured, meant, strict=True)
            if joint in self._names
        }
        path, goal, late = self._tolerances
        if stamp < self.end:
            for joint, by in off.items():
                if abs(by) > path[joint]:
                    return TrajectoryResult(
                        TrajectoryCode.PATH_TOLERANCE_VIOLATED,
                        f"{joint} is {by:+.3f} rad from its path; {path[joint]:.3f} is allowed",
                    )
            return None
        if all(abs(by) <= goal[joint] for joint, by in off.items()):
            miss = max(map(abs, off.values()), default=0.0)
            return TrajectoryResult(
                TrajectoryCode.SUCCESSFUL, f"arrived: {miss:.3f} rad from its end"
            )
        if now - self.end > late:
            worst = max(off, key=lambda joint: abs(off[joint]) / goal[joint])
            return TrajectoryResult(
                TrajectoryCode.GOAL_TOLERANCE_VIOLATED,
                f"{worst} is {off[worst]:+.3f} rad from its goal {late:.2f} s after the end; "
                f"{goal[worst]:.3f} rad is allowed",
            )
        return None


def _of(point: Waypoint, index: int) -> JointPoint:
    return JointPoint(
        point.positions[index],
        point.velocities[index] if point.velocities else None,
        point.accelerations[index] if point.accelerations and point.velocities else None,
    )


def _between(a: JointPoint, b: JointPoint, duration: float, time: float) -> JointPoint:
    """A time [s] after `a`, `duration` [s] before `b`.

    A straight line; a cubic where both velocities are said; a quintic where both accelerations are.
    """
    T, t = duration, time
    p, v = a.position, a.velocity
    way = b.position - p
    if v is None or b.velocity is None:
        return JointPoint(p + way * t / T, way / T, 0.0)
    w = b.velocity
    if a.acceleration is None or b.acceleration is None:
        c2 = (3.0 * way - (2.0 * v + w) * T) / T**2
        c3 = (-2.0 * way + (v + w) * T) / T**3
        c4 = c5 = 0.0
    else:
        c2 = 0.5 * a.acceleration
        less, more = a.acceleration * T**2, b.acceleration * T**2
        c3 = (20.0 * way - (12.0 * v + 8.0 * w) * T - 3.0 * less + more) / (2.0 * T**3)
        c4 = (-30.0 * way + (16.0 * v + 14.0 * w) * T + 3.0 * less - 2.0 * more) / (2.0 * T**4)
        c5 = (12.0 * way - 6.0 * (v + w) * T - less + more) / (2.0 * T**5)
    return JointPoint(
        p + t * (v + t * (c2 + t * (c3 + t * (c4 + t * c5)))),
        v + t * (2.0 * c2 + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5))),
        2.0 * c2 + t * (6.0 * c3 + t * (12.0 * c4 + t * 20.0 * c5)),
    )
