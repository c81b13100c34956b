"""What clients of other heads ask for: PointHead, FollowJointTrajectory, and joint_trajectory."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.node import Node

from head_tracking.gaze import PointingParameters
from head_tracking.head.head_control import HeadControl
from head_tracking.head.tasks import HeadTask, PointTask, TaskEnd, TrajectoryTask
from head_tracking.ros.head.goal_server import Goal, GoalServer
from head_tracking.ros.kit.messages import target_from_message
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.tf.conversions import stamp_to_ns
from head_tracking.tracking import (
    JointTrajectory,
    Tolerances,
    TrajectoryCode,
    TrajectoryError,
    TrajectoryParameters,
    Waypoint,
    checked_waypoints,
)
from head_tracking.transforms import RobotModelError, TransformException

try:
    from control_msgs.action import FollowJointTrajectory, PointHead
except ImportError:
    FollowJointTrajectory = PointHead = None
try:
    from trajectory_msgs.msg import JointTrajectory as TrajectoryMessage
except ImportError:
    TrajectoryMessage = None

_RESERVE = 0.8  # of the speed that is allowed after a STOP: the rest makes up for what is late
_PAUSE = 0.5  # s between two complaints of a stream


class HeadActions:
    """Offers the actions and the topic on a node that points, as tasks of its head.

    Args:
        node: offers them.
        below: the name below which they are.
        control: of the head.
        parameters: how the head turns to points, as it is now.
    """

    def __init__(
        self,
        node: Node,
        below: str,
        control: HeadControl,
        parameters: Callable[[], PointingParameters],
    ) -> None:
        self._control = control
        self._log = node.get_logger()
        self._parameters = parameters
        self._tolerances = NodeParameters(node, TrajectoryParameters)
        missing = []
        if PointHead is None:
            missing.append("no actions: control_msgs is not installed (ros-jazzy-control-msgs)")
        else:
            point, follow = f"{below}/point_head_action", f"{below}/follow_joint_trajectory"
            GoalServer(node, PointHead, point, self.point_refusal, self.point)
            GoalServer(node, FollowJointTrajectory, follow, lambda _: "", self.follow)
        if TrajectoryMessage is None:
            missing.append(
                "no joint_trajectory: trajectory_msgs is not installed (ros-jazzy-trajectory-msgs)"
            )
        else:
            node.create_subscription(
                TrajectoryMessage, f"{below}/joint_trajectory", self._on_trajectory, 10
            )
        if missing:
            self._log.info("; ".join(missing))

    def point_refusal(self, goal: Any) -> str:
        """Why a goal of PointHead is not taken, which is logged; empty: it is."""
        control = self._control
        with control.lock:
            control.watch()
            refusal = control.obstacle or self._point_mistake(goal)
            if refusal:
                control.reject(refusal)
                target = target_from_message(goal.target)
                self._log.warning(f"the goal {target} is rejected: {refusal}")
        return refusal

    def _point_mistake(self, goal: Any) -> str:
        target = target_from_message(goal.target)
        numbers = (*_axis(goal), goal.max_velocity)
        if not all(map(math.isfinite, numbers)):
            return f"{numbers} are not finite: pointing_axis and max_velocity must be"
        duration = _seconds(goal.min_duration)
        if goal.max_velocity < 0.0 or duration < 0.0:
            return (
                f"max_velocity is {goal.max_velocity:g} rad/s, min_duration {duration:g} s; "
                "neither may be below 0 (0: as usual)"
            )
        try:
            target.check()
            self._control.place_latest(target)
            self._control.pointing(goal.pointing_frame.removeprefix("/"), _axis(goal))
        except (ValueError, TransformException, RobotModelError) as error:
            return str(error)
        return ""

    def point(self, goal: Goal) -> None:
        """Begins a goal of PointHead that was not refused."""
        p, request, control = self._parameters(), goal.request, self._control

        def notify(task: HeadTask) -> None:
            if task.result is not None:
                _end(goal, task.result.end, PointHead.Result())
            elif task.miss is not None:
                goal.feedback(PointHead.Feedback(pointing_angle_error=task.miss))

        with control.lock:
            try:
                frame, axis = request.pointing_frame.removeprefix("/"), _axis(request)
                head = control.pointing(frame, axis)
            except RobotModelError as error:  # the model has just changed
                self._log.warning(f"aborted: {error}")
                goal.abort(PointHead.Result())
                return
            velocity, duration = request.max_velocity or math.inf, _seconds(request.min_duration)
            turn = control.turn(p, head, velocity, duration)
            target = target_from_message(request.target)
            task = PointTask(notify, control, target, turn, clamp=p.clamp_to_limits)
            goal.on_cancel = lambda: control.cancel(task)
            control.carry_out(task)

    def follow(self, goal: Goal) -> None:
        """Begins a goal of FollowJointTrajectory, or ends it with what is wrong with it."""
        try:
            if goal.request.multi_dof_trajectory.points:
                raise TrajectoryError(
                    TrajectoryCode.INVALID_GOAL, "multi_dof_trajectory: a head has single joints"
                )
            self._begin(goal.request.trajectory, goal)
        except TrajectoryError as error:
            self._log.warning(f"a trajectory is rejected: {error}")
            self._control.reject(str(error))
            goal.abort(
                FollowJointTrajectory.Result(error_code=int(error.code), error_string=str(error))
            )

    def _on_trajectory(self, message: Any) -> None:
        try:
            self._begin(message, None)
        except TrajectoryError as error:
            text = f"a trajectory is rejected: {error}"
            self._log.warning(text, throttle_duration_sec=_PAUSE)
            self._control.reject(str(error))

    def _begin(self, message: Any, goal: Goal | None) -> None:
        """Begins a trajectory.

        Raises:
            TrajectoryError: nothing would move, or it cannot be followed.
        """
        control = self._control

        def notify(task: HeadTask) -> None:
            assert goal is not None
            result = task.result
            if result is not None:
                message = FollowJointTrajectory.Result(
                    error_code=int(result.code), error_string=result.reason
                )
                _end(goal, result.end, message)
            elif task.reading is not None:
                goal.feedback(_feedback(trajectory, task.reading.stamp, task.reading.positions))

        with control.lock:
            control.watch()
            reading, head, obstacle = control.reading(), control.head, control.obstacle
            if reading is None or head is None or obstacle:
                raise TrajectoryError(TrajectoryCode.INVALID_GOAL, obstacle or control.trouble)
            limits = dict(zip(control.joints, (head.pan_limits, head.tilt_limits), strict=True))
            waypoints = _waypoints(message)
            names = tuple(message.joint_names) if waypoints else ()
            if waypoints:
                checked_waypoints(names, waypoints, limits)
            else:
                control.hold("preempted by an empty trajectory")
            tolerances = _tolerances(goal, names, tuple(limits), self._tolerances.value)
            now, stamp = control.now, stamp_to_ns(message.header.stamp)
            present = control.start_from(reading, control.task if waypoints else None)

            def through(waypoints: Sequence[Waypoint]) -> JointTrajectory:
                return JointTrajectory(
                    names,
                    waypoints,
                    stamp * 1e-9 if stamp else now,
                    now,
                    dict(zip(control.joints, present, strict=True)),
                    limits,
                    tolerances,
                )

            trajectory = through(waypoints)
            possible = max(limit.velocity for limit in limits.values())  # else it fails anyway
            factor = min(trajectory.peak_speed, possible) / (_RESERVE * control.fastest)
            if factor > 1.0:  # after a STOP
                self._log.info(f"the trajectory takes {factor:.1f} times as long after a stop")
                trajectory = through([waypoint.slowed(factor) for waypoint in waypoints])
            task = TrajectoryTask(None if goal is None else notify, trajectory)
            if goal is not None:
                goal.on_cancel = lambda: control.cancel(task)
            control.carry_out(task)


def _end(goal: Goal, end: TaskEnd, result: Any) -> None:
    if end is TaskEnd.SUCCEEDED:
        goal.succeed(result)
    elif end is TaskEnd.CANCELED:
        goal.cancel(result)
    else:
        goal.abort(result)


def _feedback(trajectory: JointTrajectory, stamp: float, positions: tuple[float, float]) -> Any:
    meant = trajectory.at(stamp)
    message = FollowJointTrajectory.Feedback(joint_names=list(trajectory.joints))
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(round(stamp * 1e9), 10**9)
    message.desired.positions = [point.position for point in meant]
    message.desired.velocities = [point.velocity or 0.0 for point in meant]
    message.desired.accelerations = [point.acceleration or 0.0 for point in meant]
    message.actual.positions = list(positions)
    message.error.positions = [
        point.position - position for point, position in zip(meant, positions, strict=True)
    ]
    return message


def _axis(goal: Any) -> tuple[float, float, float]:
    axis = goal.pointing_axis
    return axis.x, axis.y, axis.z


def _seconds(duration: Any) -> float:
    return float(duration.sec + duration.nanosec * 1e-9)


def _waypoints(message: Any) -> list[Waypoint]:
    return [
        Waypoint(
            _seconds(point.time_from_start),
            tuple(point.positions),
            tuple(point.velocities),
            tuple(point.accelerations),
        )
        for point in message.points
    ]


def _tolerances(
    goal: Goal | None,
    names: tuple[str, ...],
    joints: tuple[str, ...],
    usual: TrajectoryParameters,
) -> Tolerances:
    """Those of a goal: 0 means the usual one, -1 none.

    Raises:
        TrajectoryError: one is for a joint that there is not, or is no tolerance.
    """
    path = dict.fromkeys(joints, usual.path_tolerance or math.inf)
    end = dict.fromkeys(joints, usual.goal_tolerance)
    if goal is None:
        return Tolerances(path, end, usual.goal_time_tolerance)
    request = goal.request
    for what, tolerances, given in (
        ("path_tolerance", path, request.path_tolerance),
        ("goal_tolerance", end, request.goal_tolerance),
    ):
        for tolerance in given:
            if tolerance.name not in names:
                raise TrajectoryError(
                    TrajectoryCode.INVALID_JOINTS,
                    f"{what} is for {tolerance.name!r}; the trajectory is for {', '.join(names)}",
                )
            if tolerance.position == -1.0:
                tolerances[tolerance.name] = math.inf
            elif not 0.0 <= tolerance.position < math.inf:
                raise TrajectoryError(
                    TrajectoryCode.INVALID_GOAL,
                    f"{what} of {tolerance.name} is {tolerance.position} rad; give one above 0, "
                    "0 for the usual one, or -1 for none",
                )
            elif tolerance.position:
                tolerances[tolerance.name] = tolerance.position
    late = _seconds(request.goal_time_tolerance)
    if late == 0.0:
        late = usual.goal_time_tolerance
    return Tolerances(path, end, late if late > 0.0 else math.inf)
