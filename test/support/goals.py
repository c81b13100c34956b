"""Goals of PointHead for a head in simulated time, and what came of them."""

import math
import random
from typing import Any

from builtin_interfaces.msg import Duration
from control_msgs.action import FollowJointTrajectory, PointHead
from control_msgs.msg import JointTolerance
from geometry_msgs.msg import Point, PointStamped
from geometry_msgs.msg import Vector3 as Axis
from lockstep import World
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from head_tracking.gaze import PanTiltHead
from head_tracking.head.motions import MotionEnd
from head_tracking.ros.head.point_head import PointHeadNode
from head_tracking.transforms import Vector3

JOINTS = ("head_pan_joint", "head_tilt_joint")
FOLLOW = "point_head/follow_joint_trajectory"
PATIENCE = 20.0  # s


def point_goal(
    x, y, z, frame="base_link", *, velocity=0.0, duration=0.0, pointing="", axis=(0, 0, 0)
):
    made = PointHead.Goal(pointing_frame=pointing, max_velocity=float(velocity))
    made.target.header.frame_id = frame
    made.target.point = Point(x=float(x), y=float(y), z=float(z))
    made.pointing_axis = Axis(x=float(axis[0]), y=float(axis[1]), z=float(axis[2]))
    made.min_duration = Duration(sec=int(duration), nanosec=round(duration % 1 * 1e9))
    return made


def trajectory(*points, names=JOINTS, stamp=0.0):
    """Points are times, positions, and perhaps velocities and accelerations."""
    message = JointTrajectory(joint_names=list(names))
    message.header.stamp.sec, message.header.stamp.nanosec = int(stamp), int(stamp % 1 * 1e9)
    for seconds, *values in points:
        point = JointTrajectoryPoint()
        point.time_from_start = Duration(sec=int(seconds), nanosec=round(seconds % 1 * 1e9))
        for what, numbers in zip(
            ("positions", "velocities", "accelerations"), values, strict=False
        ):
            setattr(point, what, [float(number) for number in numbers])
        message.points.append(point)
    return message


def following(*points, path=None, end=None, time=0.0, **options):
    made = FollowJointTrajectory.Goal(trajectory=trajectory(*points, **options))
    made.path_tolerance = [JointTolerance(name=n, position=p) for n, p in (path or {}).items()]
    made.goal_tolerance = [JointTolerance(name=n, position=p) for n, p in (end or {}).items()]
    made.goal_time_tolerance = Duration(sec=int(time), nanosec=round(time % 1 * 1e9))
    return made


class HeldGoal:
    """A goal whose client is the test.

    Attributes:
        status: how it ended; empty: not yet.
        answer: its result.
    """

    def __init__(self, request: Any) -> None:
        self.request = request
        self.on_cancel = lambda: None
        self.status, self.answer = "", None

    def feedback(self, message: Any) -> None:
        pass

    def end(self, end: MotionEnd, result: Any) -> None:
        assert not self.status, "ended twice"
        known = (MotionEnd.SUCCEEDED, MotionEnd.CANCELED)
        self.status, self.answer = str(end if end in known else MotionEnd.ABORTED), result


class PointedHead:
    """point_head and its servos in simulated time."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.node: PointHeadNode = world.make(PointHeadNode, {"max_velocity": 5.0}, loop=world.loop)
        self._states = world.record("/point_head/state")
        self.head = PanTiltHead(world.buffer.core.model, *JOINTS, "camera_link")
        world.run(0.1)

    @property
    def true(self) -> tuple[float, float]:
        """Where pan and tilt really are [rad]."""
        pan, tilt = (self.world.true_position(joint) for joint in JOINTS)
        return pan, tilt

    def look_at(self, point: Vector3, frame: str = "", **wishes: Any) -> HeldGoal:
        """Sends a goal of PointHead and waits until it is over; no frame: the head's base."""
        goal = HeldGoal(point_goal(*point, frame or self.head.base_frame, **wishes))
        self.node.actions.point(goal)
        end = self.world.seconds + PATIENCE
        while not goal.status and self.world.seconds < end:
            self.world.run(0.01)
        return goal

    def publish(self, point: Vector3, frame: str) -> None:
        """Publishes a target without a stamp."""
        message = PointStamped(point=Point(x=point[0], y=point[1], z=point[2]))
        message.header.frame_id = frame
        self.world.publish("/target_point", message)

    def true_miss(self, point: Vector3) -> float:
        """By how much the head truly misses a point in its base frame [rad]."""
        return self.head.miss(point, *self.true)

    @property
    def said(self) -> str:
        """Its newest state."""
        return self._states[-1][1].data if self._states else ""


def random_point(rnd: random.Random) -> Vector3:
    """A point around a head, in its base frame [m]: most can be looked at, some cannot."""
    bearing, height = rnd.uniform(-3.0, 3.0), rnd.uniform(-1.2, 1.2)
    away = math.exp(rnd.uniform(math.log(0.25), math.log(8.0)))
    return (
        away * math.cos(bearing) * math.cos(height),
        away * math.sin(bearing) * math.cos(height),
        away * math.sin(height),
    )
