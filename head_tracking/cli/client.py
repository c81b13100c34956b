"""What the tools that talk to a running robot have in common: a node, its frames, its services."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass

import rclpy
from rclpy.node import Node
from std_srvs.srv import Trigger

from head_tracking.exceptions import HeadTrackingError
from head_tracking.ros.kit.spinning import NodeThreads
from head_tracking.ros.kit.start import start_ros
from head_tracking.ros.kit.stop_signal import StopSignal
from head_tracking.tf import listening_buffer
from head_tracking.transforms import TransformBuffer


class ClientError(HeadTrackingError):
    """A running robot did not do what was asked."""


@dataclass(frozen=True, slots=True)
class Client:
    """A node that spins in a thread.

    Attributes:
        node: The node.
        frames: The robot's frames and joints.
        stop: Whether the user has asked the tool to end.
    """

    node: Node
    frames: TransformBuffer
    stop: StopSignal

    def wait_for(self, condition: Callable[[], bool], seconds: float, otherwise: str) -> None:
        """Wait until a condition holds; raise ClientError with a text if it does not."""
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end or self.stop():
                raise ClientError(otherwise)
            self.stop.wait(0.02)

    def call(self, services: Sequence[str], seconds: float) -> str:
        """Call the first of some services of type Trigger that is there; return its message.

        Raises:
            ClientError: None is there within the time, it does not answer, or it fails.
        """
        clients = [self.node.create_client(Trigger, name) for name in services]
        self.wait_for(
            lambda: any(client.service_is_ready() for client in clients),
            seconds,
            f"no service {' or '.join(services)}: is head_tracking running in this domain?",
        )
        client = next(client for client in clients if client.service_is_ready())
        answer = client.call_async(Trigger.Request())
        self.wait_for(answer.done, seconds, f"no answer from {client.srv_name}")
        if not answer.result().success:
            raise ClientError(answer.result().message)
        return str(answer.result().message)


@contextmanager
def running_client(name: str) -> Iterator[Client]:
    """Start ROS and a node of this name, and end both.

    Raises:
        StartError: An argument of ROS is malformed.
    """
    with StopSignal() as stop, ExitStack() as resources:
        start_ros()
        resources.callback(rclpy.try_shutdown)
        node = Node(name, start_parameter_services=False)
        buffer = listening_buffer(node)
        resources.enter_context(closing(NodeThreads())).start(node)
        yield Client(node, buffer.core, stop)
