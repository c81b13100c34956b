"""Topics, services and parameters of a node that turns a head."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from std_msgs.msg import Bool, Float64, String
from std_srvs.srv import SetBool, Trigger

from head_tracking.control import ControlLoop, JointBackend
from head_tracking.dynamixel import StoppedError
from head_tracking.exceptions import HeadTrackingError
from head_tracking.head.head_control import HeadControl, TargetMode
from head_tracking.head.head_parameters import HeadParameters
from head_tracking.parameters import parameter
from head_tracking.ros.head.joint_topics import JointTopics
from head_tracking.ros.head.trajectory_backend import TrajectoryBackend
from head_tracking.ros.kit.diagnostics import Level, status_message
from head_tracking.ros.kit.listening import TopicListener, unheard
from head_tracking.ros.kit.messages import target_from_message
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.qos import LATCHED
from head_tracking.ros.kit.spinning import steady_timer
from head_tracking.ros.kit.topic_output import Output
from head_tracking.tf import Buffer, TransformListener
from head_tracking.tracking import ClockWatch

_WATCH_PERIOD = 0.25  # s
_UNHEARD_PERIOD = 1.0  # s


@dataclass(frozen=True, slots=True)
class DriveParameters:
    """What drives the joints."""

    command_interface: str = parameter(
        "joint_commands",
        "What drives the joints: servo_bus, by joint_commands; or a joint_trajectory_controller "
        "of the robot, by joint_trajectory. A head of the latter cannot be relaxed by `stop`.",
        choices=("joint_commands", "joint_trajectory"),
        fixed=True,
    )
    command_topic: str = parameter(
        "head_controller/joint_trajectory",
        "Where that controller listens, if it is one.",
        fixed=True,
    )
    time_from_start: float = parameter(
        0.0,
        "How long that controller has for each point; 0: it goes there at once, which suits one "
        "that begins every trajectory at the measured position (the usual one does).",
        unit="s",
        minimum=0.0,
        maximum=1.0,
        fixed=True,
    )


class HeadInterface:
    """Gives a node the control of a head, and others the topics and services of that.

    Args:
        node: subscribes `target_point`, offers `~/enable` and `~/recenter`, and publishes
            `~/enabled`, `~/state` and `~/status`.
        pointing_frame: the frame to point.
        error_topic: where the angle by which the head misses its target is published [rad].
        buffer: fed by another node of this process; None: this node listens itself.
        loop: of this process; None: there is none.
        mode: what the head does with targets.
        period: between two steps, at least [s].
        on_state: called with the text when the state has changed.

    Raises:
        ValueError: a parameter is not allowed.
        HeadTrackingError: what is to drive the joints is not there.

    Attributes:
        control: turns the head.
        unheard: which publishers of targets cannot be heard, and why; empty: none.
    """

    def __init__(
        self,
        node: Node,
        pointing_frame: str,
        error_topic: str,
        buffer: Buffer | None,
        loop: ControlLoop | None,
        mode: TargetMode,
        period: float,
        on_state: Callable[[str], object] = lambda _: None,
    ) -> None:
        self.unheard = ""
        self._on_state = on_state
        self._node = node
        self._errors = Output(node, Float64, error_topic)
        self._enabled_topic = node.create_publisher(Bool, "~/enabled", LATCHED)
        self._state_topic = node.create_publisher(String, "~/state", LATCHED)
        self._status_topic = node.create_publisher(DiagnosticStatus, "~/status", LATCHED)
        self._last_published: tuple[str, Mapping[str, str]] = "", {}
        if loop is None:
            buffer = buffer or Buffer(node=node)
            own = loop = ControlLoop(buffer.core)
            TransformListener(buffer, node, on_joints=lambda message: own.heard(message.name))
        self.control = HeadControl(
            loop,
            str(node.get_fully_qualified_name()),
            NodeParameters(node, HeadParameters).value,
            pointing_frame,
            mode,
            ClockWatch(lambda: float(node.get_clock().now().nanoseconds) * 1e-9),
            is_simulated=lambda: bool(node.get_clock().ros_time_is_active),
            period=period,
            log=node.get_logger(),
            observer=self._publish,
        )
        self._loop = loop
        self._backend = self._make_backend(NodeParameters(node, DriveParameters).value)
        if self._backend is not None:
            loop.attach(self._backend)
        TopicListener(node, PointStamped, "target_point", self._on_target)
        node.create_service(SetBool, "~/enable", self._on_enable)
        node.create_service(Trigger, "~/recenter", self._on_recenter)
        steady_timer(node, _WATCH_PERIOD, self._watch)
        steady_timer(node, _UNHEARD_PERIOD, self._check_publishers)

    def _make_backend(self, p: DriveParameters) -> JointBackend | None:
        """Return what drives the joints; None: the servo bus of this process does."""
        node, control, loop = self._node, self.control, self._loop
        if p.command_interface == "joint_commands":
            if loop.backend is not None:
                return None
            return JointTopics(node, control.name, control.joints, loop)
        if loop.backend is not None:
            name = node.get_name()
            raise HeadTrackingError(
                "command_interface is joint_trajectory, but the servo bus runs in this process; "
                f"start {name} alone (ros2 run head_tracking {name}), or leave command_interface "
                "out"
            )
        return TrajectoryBackend(
            node, p.command_topic, control.name, control.joints, p.time_from_start, loop
        )

    def begin(self) -> None:
        """Turn the head from now on; the node is complete."""
        self.control.begin()
        if self._backend is not None:
            self._backend.start()
        self._publish(None)

    def close(self) -> None:
        """Keep what was learned, and withdraw what drives the joints if this node has made it."""
        self.control.save()
        if self._backend is not None:
            self._backend.close()

    def _watch(self) -> None:
        self.control.watch()
        self._publish(None)

    def _check_publishers(self) -> None:
        self.unheard = unheard(self._node, PointStamped, "target_point")
        if self.unheard:
            self.control.warn("unheard", self.unheard)

    def _on_target(self, message: PointStamped) -> None:
        self.control.accept(target_from_message(message))

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        title = self.control.mode.title
        if not request.data:
            self.control.disable(f"{title} is switched off")
            response.success, response.message = True, f"{title} is off; the head stops"
            return response
        try:
            self.control.enable()
            response.success, response.message = True, f"{title} is on"
        except StoppedError as error:
            response.message = str(error)
        return response

    def _on_recenter(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        refusal = self.control.recenter()
        response.success = not refusal
        response.message = refusal or "recentring; the next target is followed again"
        return response

    def _publish(self, error: float | None) -> None:
        """Publish the error, and what has changed; in the thread of the loop, or of `_watch`."""
        if error is not None and self._errors.wanted:
            self._errors.publish(Float64(data=error))
        control = self.control
        with control.lock:
            off, (state, text) = control.off, control.mode.state(control)
            text = "; ".join(filter(None, (text, self.unheard)))
            fields = {
                "state": state,
                "enabled": str(not off).lower(),
                "stopped": str(control.is_stopped).lower(),
                "slow": str(control.is_cautious).lower(),
                "disabled because": off,
                "trouble": control.trouble,
                "not heard": self.unheard,
            }
            before, self._last_published = self._last_published, (text, fields)
            if (text, fields) == before:
                return
            if fields["enabled"] != before[1].get("enabled"):
                self._enabled_topic.publish(Bool(data=not off))
            hampered = off or control.trouble or self.unheard
            self._status_topic.publish(
                status_message(control.name, Level.WARN if hampered else Level.OK, text, fields)
            )
            if text != before[0]:
                self._state_topic.publish(String(data=text))
            if state != before[1].get("state"):
                self._on_state(text)

    @property
    def text(self) -> str:
        """The latest text of `~/state`."""
        return self._last_published[0]
