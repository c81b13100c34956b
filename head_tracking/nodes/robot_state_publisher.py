"""robot_state_publisher: the robot's model for everybody, and its frames on /tf."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from head_tracking.nodes.parameters import NodeParameters
from head_tracking.nodes.spinning import run_node
from head_tracking.parameters import parameter
from head_tracking.share import robot_file
from head_tracking.tf import (
    Buffer,
    StaticTransformBroadcaster,
    TransformBroadcaster,
    TransformListener,
    broadcasting_possible,
)
from head_tracking.tf.conversions import transform_to_message
from head_tracking.tf.qos import LATCHED
from head_tracking.transforms import (
    RobotModel,
    Transform,
    TransformException,
    load_robot_model,
    parse_robot_model,
    with_fixed_root,
)


@dataclass(frozen=True, slots=True)
class RobotStatePublisherParameters:
    """Which robot, and where it stands."""

    robot_description: str = parameter("", "The model as URDF text; wins over `robot`.", fixed=True)
    robot: str = parameter(
        "kinectbot", "The model: kinectbot, turtlebot, or a URDF or xacro file.", fixed=True
    )
    world_frame: str = parameter(
        "world", "A frame put above the robot's root; empty for none.", fixed=True
    )
    world_transform: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0325, 0.0, 0.0, 0.0),
        "The root in the world: x, y, z [m], yaw, pitch, roll [rad].",
        fixed=True,
    )
    publish_frequency: float = parameter(
        20.0,
        "How often /tf is sent, where tf2_msgs is installed.",
        unit="Hz",
        minimum=0.1,
        maximum=1000.0,
        fixed=True,
    )

    def __post_init__(self) -> None:
        if len(self.world_transform) != 6 or not all(map(math.isfinite, self.world_transform)):
            raise ValueError(
                f"world_transform is {list(self.world_transform)}; it needs six finite numbers: "
                "x, y, z, yaw, pitch, roll"
            )

    def model(self) -> RobotModel:
        """The model, with the world above it if one is wanted.

        Raises:
            RobotModelError: it can't be used.
            FileNotFoundError: there is no such robot.
        """
        model = (
            parse_robot_model(self.robot_description)
            if self.robot_description
            else load_robot_model(robot_file(self.robot))
        )
        if not self.world_frame or self.world_frame in model.links:
            return model
        x, y, z, yaw, pitch, roll = self.world_transform
        return with_fixed_root(
            model, self.world_frame, Transform.from_xyz_rpy((x, y, z), (roll, pitch, yaw))
        )


class RobotStatePublisherNode(Node):
    """Publishes the model, keeps a buffer of the robot's frames, and sends them on /tf.

    Args:
        buffer: fed by this node; other nodes of the same process can share it.

    Raises:
        RobotModelError: the model can't be used.
        FileNotFoundError: there is no such robot.
    """

    def __init__(self, buffer: Buffer | None = None, **options: Any) -> None:
        super().__init__("robot_state_publisher", **options)
        p = NodeParameters(self, RobotStatePublisherParameters).value
        model = p.model()
        self._buffer = buffer or Buffer()
        self._buffer.core.set_model(model)
        self._listener = TransformListener(self._buffer, self)
        self._description = self.create_publisher(String, "robot_description", LATCHED)
        self._description.publish(String(data=model.urdf))
        self.create_service(Trigger, "~/frames", self._on_frames)
        if broadcasting_possible():
            self._broadcast(model, p.publish_frequency)
        self.get_logger().info(f"robot {model.name} with {len(model.links)} links")

    def _broadcast(self, model: RobotModel, frequency: float) -> None:
        self._sender = TransformBroadcaster(self)
        self._static_sender = StaticTransformBroadcaster(self)
        joints = model.joints.values()
        self._static_sender.send_transform(
            [
                transform_to_message(self._buffer.core.lookup_transform(j.parent, j.child))
                for j in joints
                if not j.moves
            ]
        )
        self._moving = [(j.parent, j.child) for j in joints if j.moves]
        self._sent = dict.fromkeys(self._moving, 0)
        self.create_timer(1.0 / frequency, self._send_moving)

    def _send_moving(self) -> None:
        messages = []
        for frames in self._moving:
            try:
                found = self._buffer.core.lookup_transform(*frames)
            except TransformException:
                continue  # nothing is known of this joint yet
            if found.stamp != self._sent[frames]:
                self._sent[frames] = found.stamp
                messages.append(transform_to_message(found))
        if messages:
            self._sender.send_transform(messages)

    def _on_frames(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = True
        response.message = self._buffer.core.tree_as_string()
        return response


def main() -> int:
    """Runs the node until it is interrupted."""
    return run_node(RobotStatePublisherNode)


if __name__ == "__main__":
    raise SystemExit(main())
