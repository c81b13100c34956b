"""Messages of tf2_msgs where it is installed; it is not among the ROS wheels."""

try:
    from tf2_msgs.msg import TFMessage
    from tf2_msgs.srv import FrameGraph
except ImportError:
    TFMessage = FrameGraph = None

__all__ = ["FrameGraph", "TFMessage"]
