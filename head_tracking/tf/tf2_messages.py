"""tf2's messages, where they are installed: they are not among the ROS wheels."""

try:
    from tf2_msgs.msg import TFMessage
    from tf2_msgs.srv import FrameGraph
except ImportError:
    TFMessage = FrameGraph = None

__all__ = ["FrameGraph", "TFMessage", "require_tf2_msgs"]


def require_tf2_msgs() -> None:
    """Refuses what cannot be done without them.

    Raises:
        ImportError: tf2_msgs is not installed.
    """
    if TFMessage is None:
        raise ImportError(
            "tf2_msgs is not installed, so there is no /tf; it comes "
            "with a ROS 2 installation (ros-jazzy-tf2-msgs)"
        )
