"""recorder: everything that a robot says, in an MCAP file, without a page."""

from __future__ import annotations

import os
from importlib.util import find_spec
from typing import Any

from head_tracking.exceptions import HeadTrackingError
from head_tracking.ros.kit.closing_node import ClosingNode
from head_tracking.ros.kit.graph import Graph
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.other_parameters import OtherParameters
from head_tracking.ros.kit.spinning import run_node, steady_timer
from head_tracking.tf import listening_buffer

_LOOK_PERIOD = 1.0  # s
_NICENESS = 10


class RecorderNode(ClosingNode):
    """Records from its start to its end, or until the file is full.

    Raises:
        HeadTrackingError: a library is missing, or the file can't be written; says what to do.
    """

    def __init__(self, **options: Any) -> None:
        if find_spec("mcap_ros2") is None:
            raise HeadTrackingError(
                "recordings need mcap-ros2-support, which is not installed here: "
                "`ros2 run head_tracking head_setup viewer` in a workspace, "
                "pip install 'head_tracking[viewer]' elsewhere"
            )
        from head_tracking.recording.recorder import Recorder, RecorderParameters

        super().__init__("recorder", **options)
        parameters = NodeParameters(self, RecorderParameters).value
        self._graph = Graph(self)
        self._others = OtherParameters(self, self._graph, (self.get_name(),))
        self.recorder = Recorder(
            self,
            self._graph.is_below,
            parameters,
            listening_buffer(self).core,
            self._others.values,
        )
        self._said_end = False
        steady_timer(self, _LOOK_PERIOD, self._look)
        outcome = self.recorder.start()
        if not outcome.done:
            raise HeadTrackingError(outcome.text)
        self.get_logger().info(outcome.text)
        self.closing.callback(self._end)

    def _end(self) -> None:
        if self.recorder.file is not None:
            self.recorder.stop()
            self.get_logger().info(self.recorder.status)

    def _look(self) -> None:
        self._graph.look()
        self._others.look()
        if self.recorder.file is None and not self._said_end:
            self._said_end = True
            self.get_logger().error(self.recorder.status)


def main() -> int:
    """Runs the node until it is interrupted."""
    os.nice(_NICENESS)  # gives way to the robot
    return run_node(RecorderNode)
