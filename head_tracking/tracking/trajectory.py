"""Joint trajectories: waypoints in time, interpolation, and tolerances.

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

_BRAKING = 10.0  # rad/s^2, of a joint that moves before a trajectory that starts later
_BESIDE = 1e-3  # rad; a waypoint may be beyond a limit by this: planners round


class TrajectoryCode(IntEnum):
    """The result of a trajectory; FollowJointTrajectory's `error_code`."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    INVALID_JOINTS = -2
    OLD_HEADER_TIMESTAMP = -3
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5


class TrajectoryError(ValueError):
    """A trajectory that cannot be followed; the message has the reason.

    Attributes:
        code: the kind of error.
    """

    def __init__(self, code: TrajectoryCode, reason: str) -> None:
        super().__init__(reason)
        self.code = code


@dataclass(frozen=True, slots=True)
class TrajectoryParameters:
    """Tolerances of trajectories that have none of their own."""

    path_tolerance: float = parameter(
        0.0,
        "A joint that is farther from its path aborts the trajectory; 0: not checked.",
        unit="rad",
        minimum=0.0,
        maximum=6.3,
    )
    goal_tolerance: float = parameter(
        0.02,
        "A trajectory succeeds when each joint is this near its end.",
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
    """The desired positions of joints at one time.

    Attributes:
        time: from the start [s].
        positions: of each joint [rad].
        velocities: of each joint [rad/s]; empty: not given.
        accelerations: of each joint [rad/s^2]; empty: not given.
    """

    time: float
    positions: tuple[float, ...]
    velocities: tuple[float, ...] = ()
    accelerations: tuple[float, ...] = ()


class JointPoint(NamedTuple):
    """The desired state of one joint.

    Attributes:
        position: [rad].
        velocity: [rad/s]; None: not given.
        acceleration: [rad/s^2]; None: not given.
    """

    position: float
    velocity: float | None = 0.0
    acceleration: float | None = 0.0


class Tolerances(NamedTuple):
    """How far joints may be from a trajectory; inf: not checked.

    Attributes:
        path: of each joint on the way [rad].
        goal: of each joint at the end [rad].
        goal_time: how late that may be [s].
    """

    path: Mapping[str, float]
    goal: Mapping[str, float]
    goal_time: float


class TrajectoryResult(NamedTuple):
    """The result of a trajectory, by the measured joints.

    Attributes:
        code: as in FollowJointTrajectory.
        text: for a person.
    """

    code: TrajectoryCode
    text: str


def checked_waypoints(
    joints: Sequence[str], waypoints: Sequence[Waypoint], limits: Mapping[str, JointLimits]
) -> None:
    """Check that waypoints can be followed.

    Args:
        joints: names in the trajectory.
        waypoints: at least one.
        limits: of the head's joints.

    Raises:
        TrajectoryError: they cannot be followed.
    """
    known = ", ".join(limits)
    if not joints or not limits.keys() >= set(joints):
        raise TrajectoryError(
            TrajectoryCode.INVALID_JOINTS,
            f"joint_names is {list(joints)}; name {known}, or one of them",
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
                    f"{where} takes {joint} to {position:.4g} rad; allowed are "
                    f"{limits[joint].lower:.4g} to {limits[joint].upper:.4g}",
                )


class JointTrajectory:
    """A trajectory of all joints of a head, from their present desired state.

    Joints without waypoints stay where they are. Waypoints in the past are ignored; the motion to
    the first of the others begins now, or at `start` if that is later. Until then the joints brake
    and hold.

    Args:
        names: the joints of the waypoints.
        waypoints: see `checked_waypoints`; none: every joint stays.
        start: the time from which the waypoints' times count [s].
        now: the time [s].
        present: desired state of each joint of the head.
        limits: of each joint of the head; kept between waypoints, too.
        tolerances: of the joints in `names`.

    Raises:
        TrajectoryError: all waypoints are in the past.

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
        ahead = [point for point in waypoints if start + point.time > now] or waypoints[-1:]
        self._knots: dict[str, tuple[list[float], list[JointPoint]]] = {}
        for joint, here in present.items():
            times, points = [now], [here]
            if joint in names:
                index = self._names.index(joint)
                if start > now and ahead:
                    speed = here.velocity or 0.0
                    braking = min(abs(speed) / _BRAKING, start - now)
                    rest = JointPoint(here.position + 0.5 * speed * braking)
                    times += [now + braking, start]
                    points += [rest, rest]
                for waypoint in ahead:
                    point = _of(waypoint, index)
                    if start + waypoint.time > times[-1]:
                        times.append(start + waypoint.time)
                        points.append(point)
                    else:
                        points[-1] = point
            self._knots[joint] = times, points

    def at(self, time: float) -> tuple[JointPoint, ...]:
        """Return the desired state of each joint at a time [s], within its limits."""
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
        """Return the result; None while the trajectory is under way.

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
                        f"{joint} is {by:+.4g} rad from its path; {path[joint]:.4g} is allowed",
                    )
            return None
        if all(abs(by) <= goal[joint] for joint, by in off.items()):
            miss = max(map(abs, off.values()), default=0.0)
            return TrajectoryResult(
                TrajectoryCode.SUCCESSFUL, f"arrived: {miss:.4g} rad from its end"
            )
        if now - self.end > late:
            worst = max(off, key=lambda joint: abs(off[joint]) / goal[joint])
            return TrajectoryResult(
                TrajectoryCode.GOAL_TOLERANCE_VIOLATED,
                f"{worst} is {off[worst]:+.4g} rad from its goal {late:.2f} s after the end; "
                f"{goal[worst]:.4g} rad is allowed",
            )
        return None


def _of(point: Waypoint, index: int) -> JointPoint:
    return JointPoint(
        point.positions[index],
        point.velocities[index] if point.velocities else None,
        point.accelerations[index] if point.accelerations and point.velocities else None,
    )


def _between(a: JointPoint, b: JointPoint, duration: float, time: float) -> JointPoint:
    """Interpolate at a time [s] after `a`, where `b` is `duration` [s] after `a`.

    A straight line; a cubic if both velocities are given; a quintic if both accelerations are.
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
