"""The processes vision and page: they run the nodes that the supervisor asks for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rclpy.node import Node

from head_tracking.ros.kit.node_parameters import check_parameters
from head_tracking.ros.kit.spinning import NodeThreads, describe, run_ros
from head_tracking.ros.kit.stop_signal import StopSignal
from head_tracking.run.child import SupervisorLink
from head_tracking.run.node_sets import NodeSpec
from head_tracking.tf import Buffer, listening_buffer


def run_nodes(arguments: Sequence[str], stop: StopSignal, link: SupervisorLink) -> int:
    """Run nodes until `stop`; return the exit code: 1 if a node has died.

    Args:
        arguments: ROS arguments.
        stop: ends the process.
        link: receives the nodes to start, and reports the result of each start, and each STOP that
            control has not carried out in time.
    """
    resources: dict[str, Buffer] = {}
    running: dict[str, tuple[Any, bool]] = {}
    late_stops = 0

    def start(spec: NodeSpec, threads: NodeThreads) -> None:
        if spec.name in running:  # it was late, and was requested again
            report(spec.name, *running[spec.name])
            return
        node = None
        try:
            if spec.needs and not resources:
                listener = Node("vision", enable_rosout=False, start_parameter_services=False)
                resources["buffer"] = listening_buffer(listener)
                threads.start(listener)
            node = spec.make(resources)
            check_parameters([node], names=False)
        except Exception as error:
            if node is not None:
                node.destroy_node()
            return link.send(node=spec.name, problem=describe(error))
        if hasattr(node, "output"):
            node.output.set(spec.enabled)
        report(spec.name, node, spec.enabled)  # before others can discover it
        threads.start(node)

    def report(name: str, node: Any, enabled: bool) -> None:
        running[name] = node, enabled
        settled = getattr(node, "settled", {})
        link.send(node=name, problem="", enabled=enabled, parameters=settled)

    def update(threads: NodeThreads) -> None:
        nonlocal late_stops
        while not link.messages.empty():
            start(NodeSpec(**link.messages.get()), threads)
        for name, (node, before) in list(running.items()):
            if hasattr(node, "output") and node.output.on != before:
                report(name, node, node.output.on)
            if getattr(node, "late_stops", 0) > late_stops:
                late_stops = node.late_stops
                link.send(stop=True)

    return run_ros(lambda threads: threads.wait(stop, update=lambda: update(threads)), arguments)
