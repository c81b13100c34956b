"""Goals of PointHead and FollowJointTrajectory."""

from typing import Any

from builtin_interfaces.msg import Duration
from control_msgs.action import FollowJointTrajectory, PointHead
from control_msgs.msg import JointTolerance
from geometry_msgs.msg import Point
from geometry_msgs.msg import Vector3 as Axis
from rig import JOINTS
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from head_tracking.head.motions import MotionEnd

FOLLOW = "point_head/follow_joint_trajectory"


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
