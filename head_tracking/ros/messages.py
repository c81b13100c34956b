"""Between the nodes' messages and the values of the core."""

from __future__ import annotations

from collections.abc import Mapping

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PointStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from head_tracking.gaze import HeadCommand
from head_tracking.tf.conversions import ns_to_stamp, stamp_to_ns, vector
from head_tracking.tracking import Target


def command_message(
    sender: str, joints: tuple[str, ...], command: HeadCommand, stamp: Time
) -> JointState:
    """A joint_commands message for the whole head: pan and tilt; `frame_id` names the sender."""
    message = JointState()
    message.header.stamp = stamp
    message.header.frame_id = sender
    message.name = list(joints)
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


def owners_message(owners: Mapping[str, str]) -> String:
    """A joint_owners message: a line for each joint, its owner behind a colon."""
    return String(data="\n".join(f"{joint}: {owner}" for joint, owner in owners.items()))


def owners_from_message(message: String) -> dict[str, str]:
    """Each joint's owner; empty for nobody's."""
    lines = (line.partition(":") for line in message.data.splitlines())
    return {joint.strip(): owner.strip() for joint, _, owner in lines}
