"""What clients of other heads ask for: PointHead, FollowJointTrajectory, and joint_trajectory.

Each goal is a task, carried out step by step in the loop; a newer one ends the older.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rclpy.node import Node

from head_tracking.gaze import (
    AT_GOAL,
    GazeStatus,
    HeadCommand,
    PanTiltHead,
    PointingParameters,
    PointingResult,
)
from head_tracking.ros.goal_server import Goal, GoalServer
from head_tracking.ros.head_interface import HeadInterface, HeadReading, Pace
from head_tracking.ros.messages import target_from_message
from head_tracking.ros.parameters import NodeParameters
from head_tracking.tf.conversions import stamp_to_ns
from head_tracking.tracking import (
    CAUTIOUS_SPEED,
    FollowingWatch,
    JointPoint,
    JointReading,
    JointTrajectory,
    PredictiveLaw,
    SpeedLimits,
    Target,
    Tolerances,
    TrajectoryCode,
    TrajectoryError,
    TrajectoryParameters,
    Turn,
    Waypoint,
    checked_waypoints,
    stalled,
)
from head_tracking.transforms import RobotModelError, TransformException, Vector3

try:
    from control_msgs.action import FollowJointTrajectory, PointHead
except ImportError:
    FollowJointTrajectory = PointHead = None
try:
    from trajectory_msgs.msg import JointTrajectory as TrajectoryMessage
    from trajectory_msgs.msg import JointTrajectoryPoint
except ImportError:
    TrajectoryMessage = JointTrajectoryPoint = None

_PERIOD = 0.02  # s
_FEEDBACK_PERIOD = 0.035  # s
_FOLLOWS = 0.3  # s; so long after it should have moved on a joint may stand still
_PAUSE = 0.5  # s between two complaints of a stream
_FASTEST = 12.0  # rad/s; usually the model's limit is lower


class HeadTask(ABC):
    """Turns the head until it is over.

    Args:
        interface: to the head.
        goal: of an action; None: nobody waits for the end.

    Attributes:
        title: what it does.
        outcome: how it ended, for a person; empty as long as it is under way.
        succeeded: whether it ended well.
        miss: by how much the head misses what it is turned to [rad]; None: nobody knows.
    """

    title: str
    outcome = ""
    succeeded = False
    miss: float | None = None

    def __init__(self, interface: HeadInterface, goal: Goal | None) -> None:
        self.interface = interface
        self._goal = goal
        self._told = -math.inf

    @property
    def streamed(self) -> bool:
        """Whether it is one of many: nobody waits for its end."""
        return self._goal is None

    @abstractmethod
    def step(self, reading: HeadReading, law: PredictiveLaw) -> HeadCommand | None:
        """What to do now."""

    @abstractmethod
    def meant(self, time: float) -> tuple[JointPoint, JointPoint] | None:
        """Where pan and tilt are meant to be at a time [s]; None: wherever they are."""

    @abstractmethod
    def feedback(self) -> Any:
        """The message for the client; None: there is nothing to tell."""

    @abstractmethod
    def result(self, code: TrajectoryCode, text: str) -> Any:
        """The message that ends the goal."""

    def tell(self, now: float) -> None:
        """Tells the client how far it is, as often as clients want to know."""
        if self._goal is not None and not self.outcome and abs(now - self._told) > _FEEDBACK_PERIOD:
            message = self.feedback()
            if message is not None:
                self._told = now
                self._goal.feedback(message)

    def succeed(self, text: str) -> None:
        """It is done."""
        if not self.outcome:
            self.outcome, self.succeeded = text, True
            if self._goal is not None:
                self._goal.succeed(self.result(TrajectoryCode.SUCCESSFUL, text))

    def abort(self, why: str, code: TrajectoryCode = TrajectoryCode.INVALID_GOAL) -> None:
        """It cannot be done, or something else is done now."""
        if not self.outcome:
            self.outcome = f"aborted: {why}"
            if self._goal is not None:
                self._goal.abort(self.result(code, why))

    def cancel(self) -> None:
        """The client wants it no more."""
        if not self.outcome:
            self.outcome = "canceled: the head holds"
            if self._goal is not None:
                self._goal.cancel(self.result(TrajectoryCode.INVALID_GOAL, "canceled"))


class PointTask(HeadTask):
    """One goal of PointHead."""

    def __init__(
        self,
        interface: HeadInterface,
        goal: Goal,
        target: Target,
        turn: Turn,
        start_from: Callable[[float, tuple[float, float]], tuple[float, float]],
        *,
        clamp: bool,
    ) -> None:
        super().__init__(interface, goal)
        self.title = f"turning {turn.head.pointing_frame} to {target}"
        self._target = target
        self._turn = turn
        self._start_from = start_from
        self._start: tuple[float, float] | None = None
        self._clamp = clamp
        self._came = interface.now
        self._fixed: Vector3 | None = None

    def step(self, reading: HeadReading, law: PredictiveLaw) -> HeadCommand | None:
        """See `HeadTask`."""
        now, positions, turn = reading.now, reading.positions, self._turn
        joints = JointReading(reading.stamp, positions)
        moves = turn.miss is not None
        if self._start is None:
            self._start = self._start_from(now, positions)
        start = self._start
        try:
            point, stamp = self._place(now, start)
        except TransformException as error:
            if now - self._came >= self.interface.transform_timeout:
                self.abort(f"the target {self._target} cannot be placed: {error}")
            return law.stop(joints, now) if moves and self.outcome else None
        gaze = turn.aim(point, stamp, start, positions, now)
        allowed = gaze.reached or (
            self._clamp and gaze.status in (GazeStatus.OUT_OF_REACH, GazeStatus.ON_PAN_AXIS)
        )
        if not allowed:
            self.abort(gaze.reason)
            return law.stop(joints, now) if moves else None
        self.miss = turn.miss
        self._came = now
        self.interface.newest_target = self._target
        result = turn.judge(now)
        if result is None:
            return law.along(turn.positions, turn.max_velocity, joints, now)
        if result.arrived:
            self.succeed(str(result))
        else:
            self.abort(f"{result}" + (f" ({gaze.reason})" if gaze.reason else ""))
        return HeadCommand(*turn.positions(now), turn.max_velocity, turn.max_velocity)

    def meant(self, time: float) -> tuple[JointPoint, JointPoint] | None:
        """See `HeadTask`."""
        if self._turn.miss is None:
            return None
        here, soon = self._turn.positions(time), self._turn.positions(time + _PERIOD)
        pan, tilt = (JointPoint(a, (b - a) / _PERIOD, 0.0) for a, b in zip(here, soon, strict=True))
        return pan, tilt

    def feedback(self) -> Any:
        """See `HeadTask`."""
        return None if self.miss is None else PointHead.Feedback(pointing_angle_error=self.miss)

    def result(self, code: TrajectoryCode, text: str) -> Any:
        """See `HeadTask`."""
        return PointHead.Result()

    def _place(self, now: float, start: tuple[float, float]) -> tuple[Vector3, float | None]:
        """Where the target is, from the head's base, and when that was; None: it stands still.

        What moves with the head would run before it: it is looked for where it was.
        """
        interface = self.interface
        if not interface.moves_with_head(self._target.frame_id):
            return interface.newest_place(self._target)
        if self._fixed is None:
            self._fixed = interface.fixed_place(self._target, start)
        return interface.from_base(self._fixed, now), None


class TrajectoryTask(HeadTask):
    """One trajectory, of FollowJointTrajectory or of the topic."""

    def __init__(
        self, interface: HeadInterface, goal: Goal | None, trajectory: JointTrajectory
    ) -> None:
        super().__init__(interface, goal)
        self.title = "following a trajectory"
        self._trajectory = trajectory
        self._reading: HeadReading | None = None

    def step(self, reading: HeadReading, law: PredictiveLaw) -> HeadCommand | None:
        """See `HeadTask`."""
        self._reading = reading
        now, trajectory = reading.now, self._trajectory
        result = trajectory.judge(reading.stamp, reading.positions, now)
        joints = JointReading(reading.stamp, reading.positions)
        if result is None:
            return law.along(self._positions, law.fastest, joints, now)
        if result.code is TrajectoryCode.SUCCESSFUL:
            self.succeed(result.text)
            return HeadCommand(*self._positions(now), law.fastest, law.fastest)
        self.abort(result.text, result.code)
        return law.stop(joints, now)

    def meant(self, time: float) -> tuple[JointPoint, JointPoint] | None:
        """See `HeadTask`."""
        pan, tilt = self._trajectory.at(time)
        return pan, tilt

    def feedback(self) -> Any:
        """See `HeadTask`."""
        if self._reading is None:
            return None
        _, stamp, positions = self._reading
        meant = self._trajectory.at(stamp)
        message = FollowJointTrajectory.Feedback(joint_names=list(self._trajectory.joints))
        nanoseconds = round(stamp * 1e9)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(nanoseconds, 10**9)
        message.desired.positions = [point.position for point in meant]
        message.desired.velocities = [point.velocity or 0.0 for point in meant]
        message.desired.accelerations = [point.acceleration or 0.0 for point in meant]
        message.actual.positions = list(positions)
        message.error.positions = [
            point.position - position for point, position in zip(meant, positions, strict=True)
        ]
        return message

    def result(self, code: TrajectoryCode, text: str) -> Any:
        """See `HeadTask`."""
        return FollowJointTrajectory.Result(error_code=int(code), error_string=text)

    def _positions(self, time: float) -> tuple[float, float]:
        pan, tilt = self._trajectory.at(time)
        return pan.position, tilt.position


class HeadActions:
    """Offers the actions and the topic on a node that points, and carries out what they ask.

    Args:
        node: offers them.
        below: the name below which they are.
        interface: to the head; its lock is held while anything is done.
        parameters: how the head turns to points, as it is now.
        on_outcome: is told how a task ended, or why one was not begun.

    Attributes:
        task: what is carried out; None: nothing.
    """

    def __init__(
        self,
        node: Node,
        below: str,
        interface: HeadInterface,
        parameters: Callable[[], PointingParameters],
        on_outcome: Callable[[str], object],
    ) -> None:
        self.task: HeadTask | None = None
        self._on_outcome = on_outcome
        self._interface = interface
        self._log = node.get_logger()
        self._parameters = parameters
        self._tolerances = NodeParameters(node, TrajectoryParameters)
        self._pace = Pace(max(_PERIOD, interface.period))
        self._law: PredictiveLaw | None = None
        self._held: tuple[float, float] | None = None
        self._watches = [FollowingWatch(joint, _FOLLOWS) for joint in interface.joints]
        missing = []
        if PointHead is None:
            missing.append("no actions: control_msgs is not installed (ros-jazzy-control-msgs)")
        else:
            GoalServer(
                node, PointHead, f"{below}/point_head_action", self.point_refusal, self.point
            )
            GoalServer(
                node,
                FollowJointTrajectory,
                f"{below}/follow_joint_trajectory",
                lambda _: "",
                self.follow,
            )
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

    def head_known(self, head: PanTiltHead) -> None:
        """The robot's model is there, or has changed."""
        self.end("another robot_description has come")
        fastest = min(_FASTEST, max(head.pan_limits.velocity, head.tilt_limits.velocity))
        self._law = PredictiveLaw(head, self._pace.period, SpeedLimits(max_joint_speed=fastest))

    def step(self, reading: HeadReading) -> HeadCommand | None:
        """What the task does now."""
        task, law = self.task, self._law
        if task is None or law is None or not self._pace.due(reading):
            return None
        law.at_most = CAUTIOUS_SPEED if self._interface.slow else math.inf
        command = task.step(reading, law)
        meant = task.meant(reading.now)
        if meant is not None:
            self._held = meant[0].position, meant[1].position
            stuck = "" if task.outcome else self._stuck(meant, reading, law)
            if stuck:
                if task.miss is not None:
                    stuck = f"{PointingResult(False, task.miss)} ({stuck})"
                task.abort(stuck, TrajectoryCode.PATH_TOLERANCE_VIOLATED)
                command = self.halt(reading)
        if task.outcome:
            self._over(task)
        return command

    def _stuck(
        self, meant: tuple[JointPoint, JointPoint], reading: HeadReading, law: PredictiveLaw
    ) -> str:
        """Why a joint does not go on its way, by the servo bus or by its position; empty: it does.

        Args:
            meant: where pan and tilt are meant to be.
            reading: where they are.
            law: takes them there.
        """
        for watch, delay in zip(self._watches, law.delays, strict=True):
            watch.patience = _FOLLOWS + delay
        goals = [point.position for point in meant]
        speeds = [abs(point.velocity or 0.0) for point in meant]
        standing = stalled(self._watches, goals, speeds, reading.positions, reading.now)
        return self._interface.stuck or standing

    def halt(self, reading: HeadReading | None) -> HeadCommand | None:
        """The command that stops the head where it is; None if nothing is under way."""
        self._held = None
        if self.task is None or self._law is None or reading is None:
            return None
        return self._law.stop(JointReading(reading.stamp, reading.positions), reading.now)

    def end(self, why: str) -> None:
        """Ends the task, because of something else."""
        if self.task is not None:
            self.task.abort(why)
            self._over(self.task)

    def tell(self) -> None:
        """Tells the client how far it is; ends what has nothing to go by any more."""
        if self.task is None:
            return
        if self._interface.trouble:
            self.end(self._interface.trouble)
        else:
            self.task.tell(self._interface.now)

    def _over(self, task: HeadTask) -> None:
        self.task = None
        self._on_outcome(task.outcome)
        if task.succeeded:
            self._interface.slow = False
            self._log.info(f"{task.title}: {task.outcome}")
        else:
            self._log.warning(f"{task.title}: {task.outcome}")

    def _take(self, task: HeadTask, goal: Goal | None) -> None:
        streamed = task.streamed and self.task is not None and self.task.streamed
        if not streamed:
            self.end(f"preempted by a newer goal: {task.title}")
            self._log.info(task.title)
        self.task = task
        if not streamed:
            self._interface.set_out()
            for watch in self._watches:
                watch.restart()
        if goal is not None:
            goal.on_cancel = lambda: self._cancel(task)

    def _cancel(self, task: HeadTask) -> None:
        with self._interface.lock:
            if self.task is task:
                self._interface.send(self.halt(self._interface.reading()))
                task.cancel()
                self._over(task)

    def _start(
        self, now: float, present: tuple[float, float], before: HeadTask | None
    ) -> tuple[JointPoint, JointPoint]:
        """Where the joints are meant to be, from where something new begins."""
        meant = None if before is None else before.meant(now)
        if meant is not None:
            return meant
        pan, tilt = (
            JointPoint(held if abs(held - here) < AT_GOAL else here)
            for here, held in zip(present, self._held or present, strict=True)
        )
        return pan, tilt

    def point_refusal(self, goal: Any) -> str:
        """Why a goal of PointHead is not taken, which is logged; empty: it is."""
        with self._interface.lock:
            self._interface.reading()
            refusal = self._interface.obstacle or self._point_mistake(goal)
            if refusal:
                target = target_from_message(goal.target)
                self._on_outcome(f"rejected: {refusal}")
                self._log.warning(f"the goal {target} is rejected: {refusal}")
        return refusal

    def _point_mistake(self, goal: Any) -> str:
        target = _without_slash(target_from_message(goal.target))
        numbers = (*target.point, *_axis(goal), goal.max_velocity)
        if not all(map(math.isfinite, numbers)):
            return f"{numbers} are not finite: target, pointing_axis and max_velocity must be"
        duration = _seconds(goal.min_duration)
        if goal.max_velocity < 0.0 or duration < 0.0:
            return (
                f"max_velocity is {goal.max_velocity:g} rad/s, min_duration {duration:g} s; "
                "neither may be below 0 (0: as usual)"
            )
        try:
            self._interface.newest_place(target)
            self._interface.pointing(goal.pointing_frame.removeprefix("/"), _axis(goal))
        except (TransformException, RobotModelError) as error:
            return str(error)
        return ""

    def point(self, goal: Goal) -> None:
        """Begins a goal of PointHead that was not refused."""
        p, request = self._parameters(), goal.request
        with self._interface.lock:
            try:
                head = self._interface.pointing(
                    request.pointing_frame.removeprefix("/"), _axis(request)
                )
            except RobotModelError as error:  # the model has just changed
                self._log.warning(f"aborted: {error}")
                goal.abort(PointHead.Result())
                return
            turn = Turn(
                head,
                min(p.max_velocity, request.max_velocity or math.inf),
                _seconds(request.min_duration),
                p.success_angle_threshold,
                p.settle_time,
            )
            before = self.task

            def start(now: float, present: tuple[float, float]) -> tuple[float, float]:
                pan, tilt = self._start(now, present, before)
                return pan.position, tilt.position

            target = _without_slash(target_from_message(request.target))
            self._take(
                PointTask(self._interface, goal, target, turn, start, clamp=p.clamp_to_limits),
                goal,
            )

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
            self._on_outcome(f"rejected: {error}")
            goal.abort(
                FollowJointTrajectory.Result(error_code=int(error.code), error_string=str(error))
            )

    def _on_trajectory(self, message: Any) -> None:
        try:
            self._begin(message, None)
        except TrajectoryError as error:
            text = f"a trajectory is rejected: {error}"
            self._log.warning(text, throttle_duration_sec=_PAUSE)
            self._on_outcome(f"rejected: {error}")

    def _begin(self, message: Any, goal: Goal | None) -> None:
        """Begins a trajectory.

        Raises:
            TrajectoryError: nothing would move, or it cannot be followed.
        """
        interface = self._interface
        with interface.lock:
            reading, head, obstacle = interface.reading(), interface.head, interface.obstacle
            if reading is None or head is None or obstacle:
                raise TrajectoryError(TrajectoryCode.INVALID_GOAL, obstacle or interface.trouble)
            limits = dict(zip(interface.joints, (head.pan_limits, head.tilt_limits), strict=True))
            waypoints = _waypoints(message)
            names = tuple(message.joint_names) if waypoints else ()
            if waypoints:
                checked_waypoints(names, waypoints, limits)
            else:
                interface.send(self.halt(reading))
            tolerances = _tolerances(goal, names, tuple(limits), self._tolerances.value)
            now, stamp = interface.now, stamp_to_ns(message.header.stamp)
            present = self._start(now, reading.positions, self.task if waypoints else None)
            trajectory = JointTrajectory(
                names,
                waypoints,
                stamp * 1e-9 if stamp else now,
                now,
                dict(zip(interface.joints, present, strict=True)),
                limits,
                tolerances,
            )
            self._take(TrajectoryTask(interface, goal, trajectory), goal)


def _without_slash(target: Target) -> Target:
    """Clients written for tf1 put a slash before frames."""
    return replace(target, frame_id=target.frame_id.removeprefix("/"))


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
