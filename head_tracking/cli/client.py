"""The client of a running robot, for the tools that use one: a node, its frames, its services."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from typing import Any

from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from std_srvs.srv import Trigger

from head_tracking.command_line import exit_code, without_ros_arguments
from head_tracking.exceptions import HeadTrackingError
from head_tracking.gaze import PanTiltHead
from head_tracking.gaze.head_parameters import HeadParameters
from head_tracking.parameters import changed
from head_tracking.ros.kit.node_parameters import NodeParameters, check_parameters
from head_tracking.ros.kit.others import message_of, wait_for_answer
from head_tracking.ros.kit.spinning import ros_threads
from head_tracking.tf import listening_buffer
from head_tracking.transforms import TransformBuffer

_DISCOVERY = 2.0  # s for the node that turns the head: the model is known already


@dataclass(frozen=True, slots=True)
class Client:
    """A node that spins in a thread, and the robot's frames and joints."""

    node: Node
    frames: TransformBuffer

    def wait_for(self, condition: Callable[[], bool], seconds: float, error: str) -> None:
        """Wait until a condition holds; else raise HeadTrackingError with the text `error`."""
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end:
                raise HeadTrackingError(error)
            time.sleep(0.02)

    def head(self, seconds: float) -> PanTiltHead:
        """Wait some seconds for the robot's model; return its head.

        Its parameters are those of this node's command line, else of the node that turns the head.

        Raises:
            HeadTrackingError: there is no model, no such parameter or no such head.
        """
        parameters = NodeParameters(self.node, HeadParameters)
        check_parameters([self.node])
        self.wait_for(
            lambda: self.frames.model is not None,
            seconds,
            "no robot_description is published; is head_tracking running in this ROS_DOMAIN_ID? "
            "(start a simulated head with: head_tracking --sim)",
        )
        others, given = {}, self.node._parameter_overrides
        with suppress(HeadTrackingError):  # another program may turn the head
            others = self._read([f.name for f in fields(HeadParameters) if f.name not in given])
        assert self.frames.model is not None
        return changed(parameters.value, others).head(self.frames.model)

    def _read(self, names: Sequence[str]) -> dict[str, Any]:
        """Return parameters of the node that turns the head."""
        services = ("head_tracker/get_parameters", "point_head/get_parameters")
        client = self._first(GetParameters, services, _DISCOVERY)
        values = wait_for_answer(client, GetParameters.Request(names=names), _DISCOVERY).values
        return dict(zip(names, map(parameter_value_to_python, values), strict=False))

    def call(self, services: Sequence[str], seconds: float) -> str:
        """Call the first available service of type Trigger; return its message."""
        client = self._first(Trigger, services, seconds)
        return message_of(wait_for_answer(client, Trigger.Request(), seconds))

    def _first(self, kind: type, services: Sequence[str], seconds: float) -> Any:
        """Return the client of the first of these services that is available."""
        clients = [self.node.create_client(kind, name) for name in services]
        self.wait_for(
            lambda: any(client.service_is_ready() for client in clients),
            seconds,
            f"there is no service {' or '.join(services)}; is head_tracking running in this "
            "ROS_DOMAIN_ID?",
        )
        return next(client for client in clients if client.service_is_ready())


def run_client(
    name: str,
    parse: Callable[[Sequence[str]], argparse.Namespace],
    work: Callable[[Client, argparse.Namespace], int | None],
) -> int:
    """Run a tool with a client, by its command line without ROS arguments; see `exit_code`."""

    def run() -> int | None:
        options = parse(without_ros_arguments(sys.argv[1:]))
        with ros_threads() as threads:
            node = Node(name, start_parameter_services=False)
            buffer = listening_buffer(node)
            threads.start(node)
            return work(Client(node, buffer.core), options)

    return exit_code(name, run)
