"""The base class of the nodes that control a head: topics, services, parameters."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PointStamped
from std_msgs.msg import Bool, Float64, String
from std_srvs.srv import SetBool, Trigger

from head_tracking.configuration.head_nodes import DriveParameters
from head_tracking.control import ControlLoop, JointBackend
from head_tracking.exceptions import HeadTrackingError
from head_tracking.gaze.head_parameters import HeadParameters
from head_tracking.head.head_control import HeadControl
from head_tracking.head.motions import TargetMotion
from head_tracking.head.obstacle import Blocked
from head_tracking.ros.head.joint_topics import JointTopics
from head_tracking.ros.head.trajectory_backend import TrajectoryBackend
from head_tracking.ros.kit.diagnostics import Level, status_message
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.spinning import ClosingNode, steady_timer
from head_tracking.ros.kit.target_point import target_from_message
from head_tracking.ros.kit.threads import answering
from head_tracking.ros.kit.topics import LATCHED, OVERRIDABLE, TopicListener
from head_tracking.tf import listening_buffer
from head_tracking.tracking import ClockWatch, TargetState

_WATCH_PERIOD = 0.25  # s


class HeadNode(ClosingNode):
    """A node that controls a head.

    It subscribes to `target_point`, offers `~/enable` and `~/recenter`, and publishes `~/enabled`,
    `~/state` and `~/status`.

    Attributes:
        control: controls the head.
        logs_states: whether new states are logged; short pauses of the target are not.
    """

    control: HeadControl
    logs_states = False

    @property
    def failure(self) -> Exception | None:
        """The exception that has ended its part in the loop."""
        return self.control.failure

    def create_control(
        self,
        error_topic: str,
        loop: ControlLoop | None,
        targets: TargetMotion,
        period: float,
    ) -> None:
        """Create topics and services, and control the head from now on.

        Args:
            error_topic: where the angle between pointing axis and target is published [rad].
            loop: of this process; None: this node listens itself, and runs its own.
            targets: what the head does with targets.
            period: minimum time between two updates [s].

        Raises:
            ValueError: a parameter is not allowed.
            HeadTrackingError: what is to drive the joints is missing.
        """
        self._text = self._logged = ""
        self._errors = self.create_publisher(
            Float64, error_topic, 10, qos_overriding_options=OVERRIDABLE
        )
        self._enabled_topic = self.create_publisher(Bool, "~/enabled", LATCHED)
        self._state_topic = self.create_publisher(String, "~/state", LATCHED)
        self._status_topic = self.create_publisher(DiagnosticStatus, "~/status", LATCHED)
        self._fields: dict[str, str] = {}
        if loop is None:
            buffer = listening_buffer(self, on_joints=lambda message: own.heard(message.name))
            own = loop = ControlLoop(buffer.core)
        clock = self.get_clock()
        self.control = HeadControl(
            loop,
            str(self.get_fully_qualified_name()),
            NodeParameters(self, HeadParameters).value,
            targets,
            ClockWatch(lambda: float(clock.now().nanoseconds) * 1e-9),
            is_simulated=lambda: bool(clock.ros_time_is_active),
            period=period,
            log=self.get_logger(),
            observer=self._publish,
        )
        self._backend = self._make_backend(NodeParameters(self, DriveParameters).value, loop)
        if self._backend is not None:
            loop.attach(self._backend)
        self.closing.callback(self._end_control)
        TopicListener(
            self,
            PointStamped,
            "target_point",
            lambda message: self.control.accept(target_from_message(message)),
        )
        self.create_service(SetBool, "~/enable", answering(self._on_enable))
        self.create_service(Trigger, "~/recenter", answering(self._on_recenter))
        steady_timer(self, _WATCH_PERIOD, self._watch)
        self.control.begin()
        if self._backend is not None:
            self._backend.start()
        self._publish(None)

    def _make_backend(self, p: DriveParameters, loop: ControlLoop) -> JointBackend | None:
        """Return what drives the joints; None: the servo bus of this process does."""
        control = self.control
        if p.command_interface == "joint_commands":
            if loop.backend is not None:
                return None
            return JointTopics(self, control.name, control.joints, loop)
        if loop.backend is not None:
            name = self.get_name()
            raise HeadTrackingError(
                "command_interface is joint_trajectory, but the servo bus runs in this process; "
                f"start {name} alone (ros2 run head_tracking {name}), or do not set "
                "command_interface"
            )
        return TrajectoryBackend(
            self, p.command_topic, control.name, control.joints, p.time_from_start, loop
        )

    def _end_control(self) -> None:
        self.control.save()
        if self._backend is not None:
            self._backend.close()

    def _watch(self) -> None:
        self.control.watch()
        self._publish(None)

    def _on_enable(self, request: SetBool.Request) -> str:
        title = self.control.targets.title
        if request.data:
            self.control.enable()
            return f"{title} is enabled"
        self.control.disable(Blocked.DISABLED, title)
        return f"{title} is disabled; the head stops"

    def _on_recenter(self, _: Trigger.Request) -> str:
        obstacle = self.control.recenter()
        if obstacle is not None:
            raise HeadTrackingError(str(obstacle))
        return "recentring; the next target is followed again"

    def _publish(self, error: float | None) -> None:
        """Publish the error, and the state if it has changed."""
        if error is not None and self._errors.get_subscription_count():
            self._errors.publish(Float64(data=error))
        control = self.control
        with control.lock:
            off, trouble, (state, text) = control.off, control.trouble, control.state()
            obstacle, detail = off or trouble, text.removeprefix(f"{state}: ")
            is_stopped = off is not None and off.reason is Blocked.STOPPED
            fields = {
                "state": state,
                "enabled": "true" if off is None else "false",
                "stopped": "true" if is_stopped else "false",
                "slow": "true" if control.is_cautious else "false",
                "target": "false" if control.targets.miss is None else "true",
                "reason": "" if obstacle is None else obstacle.reason.value,
                "trouble": "" if trouble is None else str(trouble),
                "detail": detail,
                "refusal": control.refusal,
            }
            before, self._fields = self._fields, fields
            if fields == before:
                return
            if fields["enabled"] != before.get("enabled"):
                self._enabled_topic.publish(Bool(data=off is None))
            level = Level.OK if obstacle is None else Level.WARN
            self._status_topic.publish(status_message(control.name, level, text, fields))
            if text != self._text:
                self._text = text
                self._state_topic.publish(String(data=text))
            if self.logs_states and state not in (self._logged, TargetState.COASTING):
                self._logged = state
                self.get_logger().info(text)
