"""The actions of other heads' controllers, PointHead and FollowJointTrajectory, and the topic."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rclpy.node import Node

from head_tracking.gaze import PointingParameters
from head_tracking.head.head_control import HeadControl
from head_tracking.head.motions import Motion, MotionEnd, PointMotion, TrajectoryMotion
from head_tracking.ros.head.goal_server import ActionGoal, serve_goals
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.target_point import target_from_message
from head_tracking.ros.kit.topics import LONGEST_TEXT
from head_tracking.tf.conversions import stamp_to_ns
from head_tracking.tracking import (
    JointPoint,
    JointReading,
    JointTrajectory,
    Tolerances,
    TrajectoryCode,
    TrajectoryError,
    TrajectoryParameters,
    Waypoint,
    checked_waypoints,
)
from head_tracking.transforms import JointLimits, RobotModelError, TransformException

try:
    from control_msgs.action import FollowJointTrajectory, PointHead
except ImportError:
    FollowJointTrajectory = PointHead = None
try:
    from trajectory_msgs.msg import JointTrajectory as TrajectoryMessage
except ImportError:
    TrajectoryMessage = None

_LOG_PERIOD = 0.5  # s


class HeadActions:
    """Offers the actions and the topic, whose goals are motions of a head.

    Args:
        node: offers them.
        below: the namespace of their names.
        control: of the head.
        parameters: returns how the head turns to points at present.
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
            serve_goals(node, PointHead, point, self.point_refusal, self.point)
            serve_goals(node, FollowJointTrajectory, follow, lambda _: "", self.follow)
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

    def point_refusal(self, request: Any) -> str:
        """Return why a goal of PointHead is rejected, which is logged; empty: it is accepted."""
        control = self._control
        with control.lock:
            control.watch()
            obstacle = control.obstacle
            refusal = self._mistake(request) if obstacle is None else str(obstacle)
        if refusal:
            self._reject(f"the goal {target_from_message(request.target)}", refusal)
        return refusal

    def _reject(self, what: str, reason: str) -> None:
        """Log and record why a goal or a trajectory is not executed."""
        reason = reason[:LONGEST_TEXT]
        self._log.warning(f"{what} is rejected: {reason}", throttle_duration_sec=_LOG_PERIOD)
        self._control.reject(reason)

    def _mistake(self, request: Any) -> str:
        target, frames = target_from_message(request.target), self._control.frames
        numbers = (*_axis(request), request.max_velocity)
        if not all(map(math.isfinite, numbers)):
            return f"{numbers} are not finite: pointing_axis and max_velocity must be"
        duration = _seconds(request.min_duration)
        if request.max_velocity < 0.0 or duration < 0.0:
            return (
                f"max_velocity is {request.max_velocity:g} rad/s, min_duration {duration:g} s; "
                "neither may be below 0 (0: as usual)"
            )
        try:
            target.check()
            frames.latest_in_base(target)
            frames.pointing(request.pointing_frame.removeprefix("/"), _axis(request))
        except (ValueError, TransformException, RobotModelError) as error:
            return str(error)
        return ""

    def point(self, goal: ActionGoal) -> None:
        """Begin a goal of PointHead that was accepted."""
        request, control = goal.request, self._control

        def notify(motion: Motion) -> None:
            if motion.result is not None:
                goal.end(motion.result.end, PointHead.Result())
            elif motion.miss is not None:
                goal.feedback(PointHead.Feedback(pointing_angle_error=motion.miss))

        with control.lock:
            frame, axis = request.pointing_frame.removeprefix("/"), _axis(request)
            try:
                head = control.frames.pointing(frame, axis)
            except RobotModelError as error:  # the model has just changed
                self._log.warning(f"aborted: {error}")
                goal.end(MotionEnd.ABORTED, PointHead.Result())
                return
            p = self._parameters()
            velocity = min(request.max_velocity or p.max_velocity, p.max_velocity)
            p, duration = replace(p, max_velocity=velocity), _seconds(request.min_duration)
            target = target_from_message(request.target)
            motion = PointMotion(control, target, p, notify, head, duration)
            goal.on_cancel = lambda: control.cancel(motion)
            control.start(motion)

    def follow(self, goal: ActionGoal) -> None:
        """Begin a goal of FollowJointTrajectory, or abort it with the code of its mistake."""
        try:
            if goal.request.multi_dof_trajectory.points:
                raise TrajectoryError(
                    TrajectoryCode.INVALID_GOAL, "multi_dof_trajectory: a head has single joints"
                )
            self._begin(goal.request.trajectory, goal)
        except TrajectoryError as error:
            self._reject("a trajectory", str(error))
            goal.end(MotionEnd.ABORTED, _result(error.code, str(error)))

    def _on_trajectory(self, message: Any) -> None:
        try:
            self._begin(message, None)
        except TrajectoryError as error:
            self._reject("a trajectory", str(error))

    def _begin(self, message: Any, goal: ActionGoal | None) -> None:
        """Begin a trajectory.

        Raises:
            TrajectoryError: nothing would move, or the trajectory is not valid.
        """
        control, waypoints = self._control, _waypoints(message)

        def notify(motion: TrajectoryMotion) -> None:
            assert goal is not None
            if motion.result is not None:
                result = motion.result
                goal.end(result.end, _result(result.code, result.reason))
            elif control.readings.latest is not None:
                latest = control.readings.latest
                meant = motion.desired(latest.stamp)
                goal.feedback(_feedback(control.joints, meant, latest))

        # What takes long for many points is done without the lock, which the cycle needs.
        names = tuple(message.joint_names) if waypoints else ()
        with control.lock:
            limits = self._limits()
            epoch = control.epoch
        if waypoints:
            checked_waypoints(names, waypoints, limits)
        tolerances = _tolerances(goal, names, tuple(limits), self._tolerances.value)
        with control.lock:
            limits = self._limits()
            if control.epoch != epoch:
                stopped = "the head was stopped after this was requested"
                raise TrajectoryError(TrajectoryCode.INVALID_GOAL, stopped)
            if not waypoints:
                control.hold("preempted by an empty trajectory")
            present = dict(zip(control.joints, control.present(), strict=True))
            now, stamp = control.now, stamp_to_ns(message.header.stamp)
            start = stamp * 1e-9 if stamp else now
            path = JointTrajectory(names, waypoints, start, now, present, limits, tolerances)
            motion = TrajectoryMotion(path, control.law, None if goal is None else notify)
            if goal is not None:
                goal.on_cancel = lambda: control.cancel(motion)
            control.start(motion)

    def _limits(self) -> dict[str, JointLimits]:
        """Return the limits of the measured joints; raise TrajectoryError if nothing moves."""
        control = self._control
        with control.lock:
            control.watch()
            head, obstacle = control.frames.head, control.obstacle
            if head is None or obstacle is not None:
                raise TrajectoryError(TrajectoryCode.INVALID_GOAL, str(obstacle))
            limits = head.pan_limits, head.tilt_limits
            return dict(zip(control.joints, limits, strict=True))


def _result(code: TrajectoryCode, reason: str) -> Any:
    return FollowJointTrajectory.Result(error_code=int(code), error_string=reason)


def _feedback(
    joints: tuple[str, str], meant: tuple[JointPoint, JointPoint], measured: JointReading
) -> Any:
    message, stamp = FollowJointTrajectory.Feedback(joint_names=list(joints)), measured.stamp
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(round(stamp * 1e9), 10**9)
    message.desired.positions = [point.position for point in meant]
    message.desired.velocities = [point.velocity or 0.0 for point in meant]
    message.desired.accelerations = [point.acceleration or 0.0 for point in meant]
    message.actual.positions = list(measured.positions)
    message.error.positions = [
        point.position - position for point, position in zip(meant, measured.positions, strict=True)
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
    goal: ActionGoal | None,
    names: tuple[str, ...],
    joints: tuple[str, ...],
    usual: TrajectoryParameters,
) -> Tolerances:
    """Return the tolerances of a goal, in which 0 means the usual one, and -1 none.

    Raises:
        TrajectoryError: one is for an unknown joint, or is not valid.
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
