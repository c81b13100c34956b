"""joint_state_publisher: publishes measured joints, dependent joints and defaults."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import chain, repeat
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from sensor_msgs.msg import JointState as JointStateMsg
from std_msgs.msg import String

from head_tracking.control import ControlLoop
from head_tracking.parameters import ParameterError, parameter
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.spinning import steady_timer
from head_tracking.ros.kit.topics import LATCHED, LONGEST_TEXT, MEASUREMENT, OVERRIDABLE
from head_tracking.tf.conversions import ns_to_stamp, stamp_to_ns
from head_tracking.transforms import (
    LARGEST_POSITION,
    JointSample,
    JointState,
    JointStates,
    Mimic,
    RobotModel,
    RobotModelError,
    parse_robot_model,
)


@dataclass(frozen=True, slots=True)
class JointStatePublisherParameters:
    """The sources of joint states."""

    source_list: tuple[str, ...] = parameter(
        ("servo_states",), "Topics of measured joint states.", fixed=True, ros_name=True
    )
    publish_default_positions: bool = parameter(
        False,
        "Publish joints that are not measured at 0, or in the middle of their limits.",
        fixed=True,
    )
    rate: float = parameter(
        10.0,
        "How often defaults are published while there are no measurements.",
        unit="Hz",
        minimum=0.1,
        maximum=1000.0,
        fixed=True,
    )


class JointStatePublisherNode(Node):
    """Publishes complete `joint_states` for each measurement, with its stamp.

    A joint that is not measured is published if `zeros.<joint>` gives its position, if it mimics
    another or `dependent_joints.<joint>.parent`, `.factor` and `.offset` make it follow one, or if
    `publish_default_positions` is set.

    Args:
        loop: of the process, if it reads the servos; its buffer has the robot model. None: the
            servos are in another process, and the model is that of `robot_description`.
    """

    def __init__(self, loop: ControlLoop | None = None, **options: Any) -> None:
        super().__init__("joint_state_publisher", **options)
        p = NodeParameters(self, JointStatePublisherParameters).value
        self._default_positions = p.publish_default_positions
        self._zeros = self._declare_zeros()
        self._dependents = self._declare_dependents()
        self._model: RobotModel | None = None
        self._states: JointStates | None = None
        self._measured = False
        self._topic = self.create_publisher(
            JointStateMsg, "joint_states", 10, qos_overriding_options=OVERRIDABLE
        )
        self._own = 0 if loop is None else 1  # subscriptions of this process
        self._loop = loop
        own = ""
        if loop is None:
            self.create_subscription(String, "robot_description", self._on_description, LATCHED)
        else:
            own = self.resolve_topic_name("servo_states")
            loop.complete_by(self._complete)
            loop.observe(self._publish)
        for topic in p.source_list:
            if self.resolve_topic_name(topic) != own:
                self.create_subscription(JointStateMsg, topic, self._on_measurement, MEASUREMENT)
        steady_timer(self, 1.0 / p.rate, self._publish_defaults)

    def _declare_zeros(self) -> dict[str, float]:
        prefix = "zeros."
        names = [name.removeprefix(prefix) for name in self._given(prefix)]
        return {name: self._declare_number(prefix + name, 0.0) for name in names}

    def _declare_dependents(self) -> dict[str, Mimic]:
        prefix, dependents = "dependent_joints.", {}
        for name in {given.removeprefix(prefix).rsplit(".", 1)[0] for given in self._given(prefix)}:
            descriptor = ParameterDescriptor(description=f"The joint that {name} follows.")
            parent = self.declare_parameter(f"{prefix}{name}.parent", "", descriptor).value
            factor = self._declare_number(f"{prefix}{name}.factor", 1.0)
            dependents[name] = Mimic(
                parent, factor, self._declare_number(f"{prefix}{name}.offset", 0.0)
            )
        return dependents

    def _given(self, prefix: str) -> list[str]:
        """Return the names of the given parameters with a prefix; each ends with a joint."""
        return [name for name in self._parameter_overrides if name.startswith(prefix)]

    def _declare_number(self, name: str, default: float) -> float:
        descriptor = ParameterDescriptor(
            description="Position, factor or offset of a joint that is not measured. [rad or m]",
            dynamic_typing=True,
        )
        value = self.declare_parameter(name, default, descriptor).value
        if not isinstance(value, int | float) or not abs(value) <= LARGEST_POSITION:
            raise ParameterError(
                f"{name} is {value!r}; it must be a number within {LARGEST_POSITION:g}"
            )
        return float(value)

    def _on_description(self, message: String) -> None:
        self._use(lambda: parse_robot_model(message.data))

    def _use(self, described: Callable[[], RobotModel]) -> None:
        try:
            self._model = model = described()
            self._states = JointStates(
                model, self._zeros, self._dependents, default_positions=self._default_positions
            )
        except RobotModelError as error:
            text = f"robot_description is ignored: {error}"
            self.get_logger().error(text[:LONGEST_TEXT], throttle_duration_sec=1.0)

    def _on_measurement(self, message: JointStateMsg) -> None:
        measured = {
            name: JointState(position, velocity, effort)
            for name, position, velocity, effort in zip(
                message.name,
                message.position,
                chain(message.velocity, repeat(0.0)),
                chain(message.effort, repeat(math.nan)),
                strict=False,
            )
            if name and abs(position) <= LARGEST_POSITION
        }
        if len(measured) < max(len(message.name), len(message.position)) and message.position:
            text = (
                "each measured joint needs a unique name and a finite position; valid are only "
                f"{list(measured)} of {list(message.name)} at {list(message.position)}"
            )
            self.get_logger().error(text[:LONGEST_TEXT], throttle_duration_sec=1.0)
        self._process(stamp_to_ns(message.header.stamp), measured)

    def _process(self, stamp: int, measured: Mapping[str, JointSample]) -> None:
        if self._loop is None:
            self._publish(stamp, self._complete(measured))
            return
        states = self._loop.joints_read(stamp, measured)
        self._loop.update(measured)
        self._loop.publish(measured, stamp, states)

    def _complete(self, measured: Mapping[str, JointSample]) -> Mapping[str, JointSample]:
        """Add dependent joints and defaults; see `JointStates.complete`."""
        self._measured = True
        buffer = None if self._loop is None else self._loop.buffer
        model = None if buffer is None else buffer.model
        if model is not None and model is not self._model:
            self._use(lambda: model)
        return {} if self._states is None else self._states.complete(measured)

    def _publish_defaults(self) -> None:
        if not self._measured:
            self._process(self.get_clock().now().nanoseconds, {})
        self._measured = False

    def _publish(self, stamp: int, states: Mapping[str, JointSample]) -> None:
        if not states or self._topic.get_subscription_count() <= self._own:
            return
        message = JointStateMsg()
        message.header.stamp = ns_to_stamp(stamp)
        message.name = list(states)
        message.position = [state.position for state in states.values()]
        message.velocity = [state.velocity for state in states.values()]
        efforts = [state.effort for state in states.values()]
        message.effort = [] if all(map(math.isnan, efforts)) else efforts
        self._topic.publish(message)
