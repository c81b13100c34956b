"""Robots that run over real ROS topics and a simulated bus, all in this process."""

import gc
from contextlib import ExitStack, closing
from dataclasses import replace

import rclpy
from rclpy.signals import SignalHandlerOptions
from rig import Talker
from waiting import at_rest, failing_waits, wait_for

from head_tracking.ros.kit.spinning import NodeThreads
from head_tracking.ros.kit.stop_signal import StopSignal
from head_tracking.run.control import Composition
from head_tracking.run.node_sets import CAMERA
from head_tracking.run.options import parse_arguments


class Robot(Talker):
    """A running robot, as a person with ROS tools sees it."""

    def __init__(self, arguments: list[str], ros_args: list[str], wait: bool = True) -> None:
        with ExitStack() as resources:
            self._start(arguments, ros_args, resources)
            if wait:
                wait_for(lambda: "head_pan_joint" in self.measured)
            self._resources = resources.pop_all()

    def _start(self, arguments: list[str], ros_args: list[str], resources: ExitStack) -> None:
        gc.collect()  # a node that ends later takes /rosout from one of the same name
        plan = parse_arguments(arguments)
        # a run has the camera of a page in another process; here it would delay all nodes
        plan = replace(plan, nodes=tuple(node for node in plan.nodes if node != CAMERA))
        rclpy.init(
            args=[*plan.ros_arguments, "--ros-args", *ros_args, "--"],
            signal_handler_options=SignalHandlerOptions.NO,
        )
        resources.callback(rclpy.try_shutdown)
        self.threads = resources.enter_context(closing(NodeThreads()))
        resources.enter_context(failing_waits(self.threads))
        self.composition = Composition(plan, self.threads, StopSignal())
        self.simulated = next(iter(self.composition.simulated.values()), None)
        super().__init__(rclpy.create_node("person"))
        self.threads.start(self.node)

    def close(self) -> None:
        self._resources.close()

    def logged(self, words: str) -> str:
        """Wait for these words in the log; return the message that holds them."""
        return wait_for(lambda: next((e.msg for e in list(self.log) if words in e.msg), ""))

    def true(self, name: str) -> float:
        assert self.simulated is not None
        return self.simulated.true_position(name)

    def at_rest(self, seconds: float = 0.3) -> tuple[float, float]:
        """Waits until the head truly stands still; where."""
        return at_rest(lambda: (self.true("head_pan_joint"), self.true("head_tilt_joint")), seconds)
