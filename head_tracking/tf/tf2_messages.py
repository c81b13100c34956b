"""tf2's messages, where they are installed: they are not among the ROS wheels."""

try:
    from tf2_msgs.msg import TFMessage
    from tf2_msgs.srv import FrameGraph
except ImportError:
    TFMessage = FrameGraph = None

__all__ = ["FrameGraph", "TFMessage"]
