"""recorder: records the topics of a robot in an MCAP file, without the page."""

from __future__ import annotations

import os
from importlib.util import find_spec
from typing import Any

from head_tracking.exceptions import HeadTrackingError, RefusedError
from head_tracking.ros.kit.node_parameters import NodeParameters, check_parameters
from head_tracking.ros.kit.spinning import ClosingNode, run_node

_NICENESS = 10


class RecorderNode(ClosingNode):
    """Records until it ends or the file is full.

    Raises:
        HeadTrackingError: a library is missing, or the file cannot be written.
    """

    def __init__(self, **options: Any) -> None:
        if find_spec("mcap_ros2") is None:
            raise HeadTrackingError(
                "recordings need mcap-ros2-support, which is not installed; install it with "
                "`ros2 run head_tracking head_setup viewer` in a workspace, or with "
                "pip install 'head_tracking[page]'"
            )
        from head_tracking.recording.recorder import Recorder, RecorderParameters

        super().__init__("recorder", **options)
        parameters = NodeParameters(self, RecorderParameters).value
        self.recorder = Recorder(self, parameters)
        check_parameters([self])  # before there is a file
        self.get_logger().info(self.recorder.start())
        self.closing.callback(self._end)

    def _end(self) -> None:
        if self.recorder.file is not None:
            self.recorder.stop()
            self.get_logger().info(self.recorder.status)

    @property
    def failure(self) -> RefusedError | None:
        """The error that ends the program: the file is full."""
        return RefusedError(self.recorder.status) if self.recorder.file is None else None


def main() -> int:
    """Run the node."""
    os.nice(_NICENESS)  # the robot has priority
    return run_node(RecorderNode)
