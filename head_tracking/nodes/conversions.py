"""Between the nodes' messages and the values of the core."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PointStamped
from sensor_msgs.msg import JointState

from head_tracking.dynamixel import Goal, ServoState
from head_tracking.gaze import HeadCommand
from head_tracking.tf.conversions import ns_to_stamp, stamp_to_ns, vector
from head_tracking.tracking import Target


def servo_states_message(states: Collection[ServoState]) -> JointState:
    """What the servos measured; effort is the share of full torque, -1 to 1.

    The servos were read a fraction of a millisecond apart: the stamp is the middle of it.
    """
    message = JointState()
    message.header.stamp = ns_to_stamp(sum(state.stamp for state in states) // len(states))
    message.name = [state.joint_name for state in states]
    message.position = [state.position for state in states]
    message.velocity = [state.velocity for state in states]
    message.effort = [state.load for state in states]
    return message


def goals_from_message(message: JointState) -> dict[str, Goal]:
    """The goals of a joint_commands message; velocity, where given, is the speed to use.

    Raises:
        ValueError: the lists do not fit each other.
    """
    names = message.name
    speeds: Sequence[float | None] = message.velocity or [None] * len(names)
    if not names or not len(names) == len(message.position) == len(speeds):
        raise ValueError(
            f"{len(names)} names, {len(message.position)} positions and "
            f"{len(message.velocity)} velocities; name at least one joint, give each a position, "
            "and a velocity to all or none"
        )
    return {
        name: Goal(position, speed)
        for name, position, speed in zip(names, message.position, speeds, strict=True)
    }


def command_message(
    pan_joint: str, tilt_joint: str, command: HeadCommand, stamp: Time
) -> JointState:
    """A joint_commands message for the whole head."""
    message = JointState()
    message.header.stamp = stamp
    message.name = [pan_joint, tilt_joint]
    message.position = [command.pan, command.tilt]
    message.velocity = [command.pan_speed, command.tilt_speed]
    return message


def target_from_message(message: PointStamped) -> Target:
    """The target of a target_point message."""
    return Target(stamp_to_ns(message.header.stamp), message.header.frame_id, vector(message.point))


def target_message(target: Target) -> PointStamped:
    """A target_point message."""
    message = PointStamped()
    message.header.stamp = ns_to_stamp(target.stamp)
    message.header.frame_id = target.frame_id
    message.point.x, message.point.y, message.point.z = target.point
    return message
