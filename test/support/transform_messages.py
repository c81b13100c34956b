"""Transforms as messages."""

from geometry_msgs.msg import TransformStamped


def shifted(x: float, seconds: int, parent: str = "map", child: str = "ball") -> TransformStamped:
    """The child stands `x` [m] before its parent, at a whole second."""
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    message.header.stamp.sec = seconds
    message.transform.translation.x = x
    return message
