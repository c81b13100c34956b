"""What the nodes that turn a head have in common: its geometry, its joints, its targets."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from head_tracking.gaze import HeadCommand, PanTiltHead
from head_tracking.nodes.conversions import command_message, target_from_message
from head_tracking.nodes.parameters import NodeParameters
from head_tracking.parameters import parameter
from head_tracking.tf import Buffer, listening_buffer
from head_tracking.tracking import Target, TargetPlacer
from head_tracking.transforms import RobotModel, TransformException, Vector3


@dataclass(frozen=True, slots=True)
class HeadParameters:
    """Which joints make up the head, and how far they go."""

    head_pan_joint: str = parameter(
        "head_pan_joint", "The joint that turns the head left and right.", fixed=True
    )
    head_tilt_joint: str = parameter(
        "head_tilt_joint", "The joint that turns it up and down.", fixed=True
    )
    pointing_axis: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0),
        "The direction in the pointed frame to point; 0 0 0: z of an optical frame, else x.",
        fixed=True,
    )
    min_pan: float = parameter(
        -10.0, "Narrows the model's limit.", unit="rad", minimum=-10.0, maximum=10.0, fixed=True
    )
    max_pan: float = parameter(
        10.0, "Narrows the model's limit.", unit="rad", minimum=-10.0, maximum=10.0, fixed=True
    )
    min_tilt: float = parameter(
        -10.0, "Narrows the model's limit.", unit="rad", minimum=-10.0, maximum=10.0, fixed=True
    )
    max_tilt: float = parameter(
        10.0, "Narrows the model's limit.", unit="rad", minimum=-10.0, maximum=10.0, fixed=True
    )
    transform_timeout: float = parameter(
        1.0,
        "How long a target waits for its frame or for the joint states of its time.",
        unit="s",
        minimum=0.0,
        maximum=60.0,
        fixed=True,
    )
    target_latency: float = parameter(
        0.0,
        "Targets are so much older than their stamps say, as of a camera that stamps late.",
        unit="s",
        minimum=-1.0,
        maximum=1.0,
        fixed=True,
    )
    joint_state_timeout: float = parameter(
        0.5,
        "Without joint states for so long the head is left alone.",
        unit="s",
        minimum=0.05,
        maximum=60.0,
        fixed=True,
    )

    def head(self, model: RobotModel, pointing_frame: str) -> PanTiltHead:
        """The head of this robot.

        Raises:
            RobotModelError: the model has no such head.
        """
        return PanTiltHead(
            model,
            self.head_pan_joint,
            self.head_tilt_joint,
            pointing_frame,
            self.pointing_axis if any(self.pointing_axis) else None,
            (self.min_pan, self.max_pan),
            (self.min_tilt, self.max_tilt),
        )


class HeadInterface:
    """Connects a node to the head that it turns.

    Args:
        node: subscribes `target_point` and publishes `joint_commands`.
        pointing_frame: the frame to point.
        error_topic: where the angle by which the head misses its target goes [rad].
        buffer: fed by another node of this process; None: this node listens itself.
        on_head: called when the robot's model is there, and again when it changes.
        on_target: called when a target has come.

    Raises:
        ValueError: a parameter is not allowed.
    """

    def __init__(
        self,
        node: Node,
        pointing_frame: str,
        error_topic: str,
        buffer: Buffer | None,
        on_head: Callable[[PanTiltHead], None],
        on_target: Callable[[], None] = lambda: None,
    ) -> None:
        self._node = node
        self._log = node.get_logger()
        self._parameters = NodeParameters(node, HeadParameters).value
        self._pointing_frame = pointing_frame
        self._buffer = (buffer or listening_buffer(node)).core
        self._on_head = on_head
        self._on_target = on_target
        self._model: RobotModel | None = None
        self._placer: TargetPlacer | None = None
        self._started = int(node.get_clock().now().nanoseconds)
        self._commands = node.create_publisher(JointState, "joint_commands", 1)
        self._errors = node.create_publisher(Float64, error_topic, 10)
        node.create_subscription(PointStamped, "target_point", self._on_message, 10)

    @property
    def now(self) -> float:
        """The time [s] on the node's clock."""
        return float(self._node.get_clock().now().nanoseconds) * 1e-9

    def positions(self) -> tuple[float, float] | None:
        """Pan and tilt as measured [rad]; None, and a warning, without a fresh measurement."""
        reading = self.reading()
        return None if reading is None else reading[1]

    def reading(self) -> tuple[float, tuple[float, float]] | None:
        """Time [s] and positions [rad] as measured; None, and a warning, without a fresh one."""
        p = self._parameters
        found, stamps = [], []
        for joint in (p.head_pan_joint, p.head_tilt_joint):
            stamp, position = self._buffer.latest_joint_position(joint) or (self._started, None)
            age = self.now - stamp * 1e-9
            if age > p.joint_state_timeout:
                self._log.warning(
                    f"no position of {joint} in joint_states for {age:.1f} s: the head is left "
                    "alone",
                    throttle_duration_sec=2.0,
                )
                return None
            if position is None:
                return None
            found.append(position)
            stamps.append(stamp)
        return min(stamps) * 1e-9, (found[0], found[1])

    def ready(self) -> bool:
        """Whether the robot's model is there; makes the head of a new one.

        Raises:
            RobotModelError: the model has no such head.
        """
        model = self._buffer.model
        if model is None:
            self._log.info("waiting for robot_description", throttle_duration_sec=2.0)
            return False
        if model is not self._model:
            head = self._parameters.head(model, self._pointing_frame)
            self._model = model
            self._placer = TargetPlacer(
                self._buffer, head.base_frame, self._parameters.transform_timeout
            )
            self._on_head(head)
        return True

    def take_targets(self, moving_with_head: Mapping[str, float]) -> list[tuple[Target, Vector3]]:
        """New targets and their places in the head's base frame; see `TargetPlacer.place`."""
        assert self._placer is not None
        try:
            return self._placer.place(self.now, moving_with_head)
        except TransformException as error:
            self._refuse(error)
            return []

    def take_newest_target(
        self, moving_with_head: Mapping[str, float]
    ) -> tuple[Target, Vector3] | None:
        """The newest target only; see `TargetPlacer.place_newest`."""
        assert self._placer is not None
        try:
            return self._placer.place_newest(self.now, moving_with_head)
        except TransformException as error:
            self._refuse(error)
            return None

    def send(self, command: HeadCommand | None) -> None:
        """Publishes a command for both joints, if there is one."""
        if command is not None:
            p = self._parameters
            stamp = self._node.get_clock().now().to_msg()
            self._commands.publish(
                command_message(p.head_pan_joint, p.head_tilt_joint, command, stamp)
            )

    def publish_error(self, error: float | None) -> None:
        """Publishes by how much the head misses its target [rad], if it has one."""
        if error is not None:
            self._errors.publish(Float64(data=error))

    def forget_targets(self) -> None:
        """Drops targets that wait for their transforms."""
        if self._placer is not None:
            self._placer.forget()

    def _on_message(self, message: PointStamped) -> None:
        if not self.ready() or self._placer is None:
            return
        try:
            self._placer.offer(self._dated(target_from_message(message)), self.now)
        except TransformException as error:
            self._refuse(error)
            return
        self._on_target()

    def _refuse(self, error: TransformException) -> None:
        self._log.error(f"target refused: {error}", throttle_duration_sec=1.0)

    def _dated(self, target: Target) -> Target:
        latency = round(self._parameters.target_latency * 1e9)
        return replace(target, stamp=target.stamp - latency) if target.stamp else target
