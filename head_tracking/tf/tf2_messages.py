"""tf2's message, where it is installed: it is not among the ROS wheels."""

try:
    from tf2_msgs.msg import TFMessage
except ImportError:
    TFMessage = None

__all__ = ["TFMessage"]
