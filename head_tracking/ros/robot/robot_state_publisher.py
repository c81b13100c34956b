"""robot_state_publisher: publishes the robot model, and its frames on /tf."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from head_tracking.control import ControlLoop
from head_tracking.exceptions import HeadTrackingError
from head_tracking.parameters import ParameterError, parameter
from head_tracking.ros.kit.diagnostics import Level, report
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.spinning import steady_timer
from head_tracking.ros.kit.threads import answering
from head_tracking.ros.kit.topics import LATCHED
from head_tracking.share import robot_file
from head_tracking.tf import (
    Buffer,
    StaticTransformBroadcaster,
    TransformBroadcaster,
    TransformListener,
    broadcasting_possible,
)
from head_tracking.tf.conversions import stamp_to_ns
from head_tracking.tf.messages import transform_stamped
from head_tracking.transforms import (
    RobotModel,
    Transform,
    load_robot_model,
    parse_robot_model,
    with_fixed_root,
)

_DIAGNOSTICS_PERIOD = 1.0  # s
_JUMP = 1_000_000_000  # ns; when stamps go back by more, the clock has jumped back


@dataclass(frozen=True, slots=True)
class RobotStatePublisherParameters:
    """The robot model and its pose in the world."""

    robot_description: str = parameter(
        "", "The model as URDF text; has priority over `robot`, also while running."
    )
    robot: str = parameter("kinectbot", "The model: its name, or a URDF or xacro file.", fixed=True)
    calibration: str = parameter(
        "", "A file written by `calibrate`, which is applied to the model.", fixed=True
    )
    world_frame: str = parameter(
        "",
        "A frame above the root of the robot; empty for none, as for a robot that drives: its "
        "odometry publishes one.",
        fixed=True,
    )
    world_transform: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0325, 0.0, 0.0, 0.0),
        "The root in the world: x, y, z [m], yaw, pitch, roll [rad].",
        fixed=True,
    )
    publish_frequency: float = parameter(
        20.0,
        "The highest rate of /tf, where tf2_msgs is installed.",
        unit="Hz",
        minimum=0.1,
        maximum=1000.0,
        fixed=True,
    )
    frame_prefix: str = parameter("", "Put before the names of the robot's links.", fixed=True)
    ignore_timestamp: bool = parameter(
        False, "Publish /tf for all joint states, also if their stamps stay or go back.", fixed=True
    )

    def __post_init__(self) -> None:
        if len(self.world_transform) != 6 or not all(map(math.isfinite, self.world_transform)):
            raise ParameterError(
                f"world_transform is {list(self.world_transform)}; it needs six finite numbers: "
                "x, y, z, yaw, pitch, roll"
            )

    def model(self) -> RobotModel:
        """Return the model, calibrated and below `world_frame`.

        Raises:
            RobotModelError: it is not valid.
            FileNotFoundError: there is no such robot.
            CalibrationFileError: the calibration is not valid for it.
        """
        model = (
            parse_robot_model(self.robot_description)
            if self.robot_description
            else load_robot_model(robot_file(self.robot))
        )
        if self.calibration:
            from head_tracking.calibration import Calibration

            model = Calibration.load(self.calibration).apply(model)
        if not self.world_frame or self.world_frame in model.links:
            return model
        x, y, z, yaw, pitch, roll = self.world_transform
        return with_fixed_root(
            model, self.world_frame, Transform.from_xyz_rpy((x, y, z), (roll, pitch, yaw))
        )


class RobotStatePublisherNode(Node):
    """Publishes the model, fills a buffer with the robot's frames, and sends them on /tf.

    Args:
        buffer: is filled; other nodes of the same process can share it.
        loop: of the process, if it reads the joints.

    Raises:
        RobotModelError: the model is not valid.
        FileNotFoundError: there is no such robot.
    """

    def __init__(
        self, buffer: Buffer | None = None, loop: ControlLoop | None = None, **options: Any
    ) -> None:
        super().__init__("robot_state_publisher", **options)
        self._settings = NodeParameters(
            self,
            RobotStatePublisherParameters,
            on_change=lambda changed: self._use(changed.model()),
            check=_check_model,
        )
        p = self._settings.value
        self._buffer = buffer or Buffer(node=self)
        self._description = self.create_publisher(String, "robot_description", LATCHED)
        if broadcasting_possible():
            self._sender = TransformBroadcaster(self)
            self._static_sender = StaticTransformBroadcaster(self)
        self._use(p.model())
        self._period = round(1e9 / p.publish_frequency)
        self._due = 0  # the stamp of the next message on /tf [ns]
        self._jump = 0 if p.ignore_timestamp else _JUMP
        TransformListener(
            self._buffer, self, frame_prefix=p.frame_prefix, on_joints=self._on_joints
        )
        if loop is not None:
            loop.observe(lambda stamp, _: self._send_moving(stamp))
        self.create_service(Trigger, "~/frames", answering(self._on_frames))
        if p.calibration:
            from head_tracking.calibration import Calibration, summary

            calibration = self._calibration = Calibration.load(p.calibration)
            self._values = {"source": p.calibration, "views": str(calibration.views)}
            for name, change, deviation in summary(calibration):
                self._values[name] = f"{change} {deviation}"
            self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
            steady_timer(self, _DIAGNOSTICS_PERIOD, self._publish_calibration)

    def _use(self, model: RobotModel) -> None:
        self._model = model.prefixed(self._settings.value.frame_prefix)
        self._buffer.core.set_model(self._model)
        self._description.publish(String(data=model.urdf))
        if broadcasting_possible():
            self._static_sender.forget()
            self._static_sender.sendTransform(self._edges(moving=False))
        self.get_logger().info(f"robot {model.name} with {len(model.links)} links")

    def _on_joints(self, message: JointState) -> None:
        self._send_moving(stamp_to_ns(message.header.stamp))

    def _send_moving(self, stamp: int) -> None:
        """Send the moving frames, unless that is more than half a period too early."""
        # one of the subscriptions is that of this node's listener
        if not broadcasting_possible() or self._sender.pub_tf.get_subscription_count() < 2:
            return
        early = self._due - stamp
        if self._period // 2 <= early < self._jump:
            return
        due = stamp if early >= self._jump else self._due
        self._due = max(due, stamp - self._period // 2) + self._period
        if moving := self._edges(moving=True):
            self._sender.sendTransform(moving)

    def _publish_calibration(self) -> None:
        """Publish the age of the calibration, and each value with its standard deviation."""
        calibration = self._calibration
        level = Level.WARN if calibration.is_old else Level.OK
        text = calibration.age_text
        self._diagnostics.publish(report(self, "calibration", level, text, self._values))

    def _edges(self, *, moving: bool) -> list[TransformStamped]:
        """Return the known transforms of all joints that move, or of all fixed joints."""
        core, found = self._buffer.core, []
        for joint in self._model.joints.values():
            if joint.moves is moving and core.can_transform(joint.parent, joint.child):
                found.append(transform_stamped(core.lookup_transform(joint.parent, joint.child)))
        return found

    def _on_frames(self, _: Trigger.Request) -> str:
        return self._buffer.core.tree_as_string(self.get_clock().now().nanoseconds)


def _check_model(parameters: RobotStatePublisherParameters) -> None:
    try:
        parameters.model()
    except (HeadTrackingError, FileNotFoundError) as error:
        raise ParameterError(str(error)) from error
