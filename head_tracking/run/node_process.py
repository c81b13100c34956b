"""The processes vision and page: nodes that the supervisor asks for, one after the other."""

from __future__ import annotations

import queue
from collections.abc import Sequence
from typing import Any

from rclpy.node import Node

from head_tracking.ros.kit import parameter_sources
from head_tracking.ros.kit.spinning import NodeThreads, describe, run_threads
from head_tracking.ros.kit.stop_signal import StopSignal
from head_tracking.run.child import SupervisorLine
from head_tracking.run.node_sets import NodeSpec
from head_tracking.run.true_positions import TruePositions
from head_tracking.tf import Buffer, TransformListener


class _Shared(dict[str, Any]):
    """What the nodes of the process share, made for the first one that needs it."""

    def __init__(self, threads: NodeThreads) -> None:
        super().__init__()
        self._threads = threads

    def __missing__(self, name: str) -> Any:
        node = Node("vision", enable_rosout=False, start_parameter_services=False)
        self["buffer"] = Buffer(node=node)
        TransformListener(self["buffer"], node)
        self["true_position"] = TruePositions(node).now
        self._threads.start(node)
        return self[name]


def run_nodes(arguments: Sequence[str], stop: StopSignal, line: SupervisorLine) -> int:
    """Run nodes until somebody asks to stop; return the exit code: 1 if one has died.

    Args:
        arguments: ROS's.
        stop: asks to stop.
        line: asks for nodes, and is told which work.
    """
    wanted: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    threads = NodeThreads()
    shared = _Shared(threads)
    reported: dict[str, tuple[Any, bool]] = {}

    def start(enabled: bool, **spec: Any) -> None:
        try:
            node = NodeSpec(**spec).make(shared)
            parameter_sources.check([node], names=False)
        except Exception as error:
            line.send(node=spec["name"], problem=describe(error), enabled=enabled)
            if reported:  # the others go on
                return
            raise
        if hasattr(node, "enabled"):
            node.enabled = enabled
        threads.start(node)
        report(spec["name"], node, enabled)

    def report(name: str, node: Any, enabled: bool) -> None:
        reported[name] = node, enabled
        line.send(node=name, problem="", enabled=enabled)

    def work() -> None:
        while not wanted.empty():
            start(**wanted.get())
        for name, (node, before) in list(reported.items()):
            if getattr(node, "enabled", before) != before:
                report(name, node, not before)

    return run_threads(stop, threads, lambda: line.receive(wanted.put), arguments, work)
