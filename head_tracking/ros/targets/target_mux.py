"""target_mux: select one of several targets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from geometry_msgs.msg import PointStamped, PoseStamped
from rclpy.node import Node
from std_msgs.msg import String

from head_tracking.parameters import ParameterError, parameter
from head_tracking.ros.kit.images import frame_pose
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.spinning import steady_timer
from head_tracking.ros.kit.target_point import TargetOutput, target_from_message
from head_tracking.ros.kit.topics import LATCHED, LONGEST_TEXT, TopicListener
from head_tracking.targets import MuxParameters, SourceParameters, TargetMux, between
from head_tracking.tf import Buffer, listening_buffer
from head_tracking.tracking import Target
from head_tracking.transforms import LATEST, Vector3

_MESSAGES = {"point": PointStamped, "pose": PoseStamped}

_TRANSITION_TIMEOUT = 1.0  # s after the last target: later targets need no transition

_PUBLISHED_ONCE = {"priority": 30, "timeout": 30.0, "repeat": True}
_DEFAULTS: dict[str, dict[str, Any]] = {
    "clicked_point": {"topic": "clicked_point", **_PUBLISHED_ONCE},
    "target_pose": {"topic": "target_pose", "type": "pose", **_PUBLISHED_ONCE},
}


@dataclass(frozen=True, slots=True)
class MuxWiring:
    """Sources, and transitions between them."""

    sources: tuple[str, ...] = parameter(
        ("clicked_point", "target_pose", "visual_target", "frame_target", "fictitious_target"),
        "Names of the sources; each has its own parameters.",
        fixed=True,
        ros_name=True,
    )
    fixed_frame: str = parameter(
        "base_link", "A frame that does not move with the head.", fixed=True
    )
    pointing_frame: str = parameter(
        "camera_link", "The frame that is pointed, the centre of transitions.", fixed=True
    )
    camera_link: str = parameter("", "Former name of `pointing_frame`; has priority.", fixed=True)
    switch_time: float = parameter(
        0.6,
        "Duration of the transition to another source; 0: none.",
        unit="s",
        minimum=0.0,
        maximum=10.0,
    )
    rate: float = parameter(
        20.0,
        "Rate of repeated targets.",
        unit="Hz",
        minimum=1.0,
        maximum=200.0,
        fixed=True,
    )


class TargetMuxNode(Node):
    """Publishes `target_point` and the name of its source on `~/selected`; `~/pin` selects one."""

    def __init__(self, buffer: Buffer | None = None, **options: Any) -> None:
        super().__init__("target_mux", **options)
        self._wiring = NodeParameters(self, MuxWiring)
        wiring = self._wiring.value
        if not wiring.sources:
            raise ParameterError("sources is empty; it needs the name of one source at least")
        self._buffer = (buffer or listening_buffer(self)).core
        self._sources = {name: self._source(name, rank) for rank, name in enumerate(wiring.sources)}
        self._mux = TargetMux(
            self._sources,
            NodeParameters(self, MuxParameters, on_change=self._on_parameters).value,
        )
        self._transition: tuple[Vector3, float] | None = None  # its start, and since when [s]
        self._latest: dict[str, Target] = {}
        self._repeated: dict[str, Target | None] = {}
        self._selected: str | None = None
        self._last_sent: tuple[Vector3, float] | None = None
        self._targets = TargetOutput(self)
        self._name_publisher = self.create_publisher(String, "~/selected", LATCHED)
        self._name_publisher.publish(String())
        self.create_subscription(String, "~/pin", self._on_pin, 10)
        for name, p in self._sources.items():
            if self.resolve_topic_name(p.topic) == self._targets.topic:
                raise ParameterError(
                    f"{name}.topic is {p.topic}, the output topic of this node; give the source "
                    "another topic"
                )
            TopicListener(self, _MESSAGES[p.type], p.topic, self._receiver(name))
        steady_timer(self, 1.0 / wiring.rate, self._step)

    @property
    def _now(self) -> float:
        return float(self.get_clock().now().nanoseconds) * 1e-9

    def _source(self, name: str, rank: int) -> SourceParameters:
        # the default priorities follow the order of the list
        defaults = {"priority": 20 - rank} | _DEFAULTS.get(name, {})
        p = NodeParameters(self, SourceParameters, f"{name}.", defaults).value
        return replace(p, topic=p.topic or f"{name}/target_point")

    def _receiver(self, name: str) -> Callable[[PointStamped | PoseStamped], None]:
        def receive(message: PointStamped | PoseStamped) -> None:
            if isinstance(message, PoseStamped):
                message = PointStamped(header=message.header, point=message.pose.position)
            self._on_target(name, target_from_message(message))

        return receive

    def _on_parameters(self, parameters: MuxParameters) -> None:
        self._mux.parameters = parameters

    def _on_pin(self, message: String) -> None:
        try:
            self._mux.pin(message.data or None)
        except ValueError as error:
            text = f"pin refused: {error}"
            self.get_logger().error(text[:LONGEST_TEXT], throttle_duration_sec=1.0)
            return
        self._use(self._mux.select(self._now))

    def _on_target(self, name: str, target: Target) -> None:
        try:
            target.check()
        except ValueError as error:
            self.get_logger().error(
                f"{name}: the target {target} is ignored: {error}", throttle_duration_sec=1.0
            )
            return
        if self._sources[name].repeat:
            # a repeated point must not move with the camera: one without a place is sent once
            placed = self._repeated[name] = self._in_fixed_frame(target)
            target = placed or target
        self._latest[name] = target
        self._use(self._mux.offer(name, self._now), arrived=name)

    def _step(self) -> None:
        self._use(self._mux.select(self._now))
        target = None if self._selected is None else self._repeated.get(self._selected)
        if target is not None:
            self._send(replace(target, stamp=self.get_clock().now().nanoseconds))

    def _use(self, selected: str | None, arrived: str = "") -> None:
        """Publish the target of a source if it has arrived now, or has waited to be selected."""
        is_new = selected != self._selected
        if is_new:
            self._set_selected(selected)
        if selected is not None and (
            selected == arrived or (is_new and not self._sources[selected].repeat)
        ):
            self._send(self._latest[selected])

    def _set_selected(self, selected: str | None) -> None:
        self.get_logger().info(f"selected target: {selected or 'none'}")
        self._selected = selected
        self._name_publisher.publish(String(data=selected or ""))
        if selected is not None and self._last_sent is not None:
            point, when = self._last_sent
            if self._now - when < _TRANSITION_TIMEOUT:
                self._transition = point, self._now

    def _send(self, target: Target) -> None:
        if not self._targets.on:
            return
        placed = self._in_fixed_frame(target)
        if placed is not None and self._transition is not None:
            start, since = self._transition
            passed, duration = self._now - since, self._wiring.value.switch_time
            if passed < duration:
                point = between(start, placed.point, passed / duration, self._centre())
                target = placed = replace(placed, point=point)
            else:
                self._transition = None
        self._last_sent = None if placed is None else (placed.point, self._now)
        self._targets.publish(target)

    def _in_fixed_frame(self, target: Target) -> Target | None:
        """Return a target in the fixed frame; None: its transform is not known."""
        fixed_frame = self._wiring.value.fixed_frame
        pose = frame_pose(self._buffer, fixed_frame, target.frame_id, target.stamp)
        if pose is None:
            self.get_logger().warning(
                f"the target {target} is published without a transition: its transform to "
                f"{fixed_frame} is not known",
                throttle_duration_sec=2.0,
            )
            return None
        return Target(target.stamp, fixed_frame, pose @ target.point)

    def _centre(self) -> Vector3:
        wiring = self._wiring.value
        frame = wiring.camera_link or wiring.pointing_frame
        pose = frame_pose(self._buffer, wiring.fixed_frame, frame, LATEST)
        return (0.0, 0.0, 0.0) if pose is None else pose.translation
