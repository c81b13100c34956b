"""What the nodes that turn a head have in common: its geometry, its joints, its targets."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from std_msgs.msg import Bool, Float64, String
from std_srvs.srv import SetBool, Trigger

from head_tracking.control import STOPPED, ControlLoop, OwnershipError
from head_tracking.dynamixel import Goal, StoppedError
from head_tracking.exceptions import HeadTrackingError
from head_tracking.gaze import HeadCommand, PanTiltHead
from head_tracking.parameters import parameter
from head_tracking.ros.joint_topics import JointTopics
from head_tracking.ros.listening import TopicListener, listen_for, unheard
from head_tracking.ros.messages import target_from_message
from head_tracking.ros.output import Output
from head_tracking.ros.parameters import NodeParameters
from head_tracking.ros.spinning import steady_timer
from head_tracking.ros.trajectory_output import TrajectoryOutput
from head_tracking.tf import Buffer
from head_tracking.tf.qos import LATCHED
from head_tracking.tracking import ClockWatch, HeadBase, Refusal, Target, TargetPlacer
from head_tracking.transforms import (
    LATEST,
    RobotModel,
    RobotModelError,
    TransformException,
    Vector3,
)

_WATCH_PERIOD = 0.25  # s
_TELL_PERIOD = 1.0  # s
_PATIENCE = 0.2  # s
_MOST_WAITING = 1000  # targets, until the next cycle
_MOST_TOLD = 100  # things at a time; anybody may send targets in frames of any name


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
    fixed_frame: str = parameter(
        "",
        "The frame that stands still: targets are placed and their motion is estimated in it. "
        "Empty: the link that carries the pan joint; odom or map for a robot that drives.",
        fixed=True,
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

    def head(
        self, model: RobotModel, pointing_frame: str, axis: tuple[float, ...] | None = None
    ) -> PanTiltHead:
        """The head of this robot.

        Args:
            model: of the robot.
            pointing_frame: the frame to point.
            axis: the direction in it to point; None: `pointing_axis`.

        Raises:
            RobotModelError: the model has no such head.
        """
        axis = self.pointing_axis if axis is None else axis
        return PanTiltHead(
            model,
            self.head_pan_joint,
            self.head_tilt_joint,
            pointing_frame,
            axis if any(axis) else None,
            (self.min_pan, self.max_pan),
            (self.min_tilt, self.max_tilt),
        )


class HeadReading(NamedTuple):
    """The head as it was measured last.

    Attributes:
        now: the time [s].
        stamp: when it was measured [s].
        positions: pan and tilt [rad].
    """

    now: float
    stamp: float
    positions: tuple[float, float]


class Pace:
    """Tells when it is time for the next step of something that takes equal ones.

    Args:
        period: between two steps [s].
    """

    def __init__(self, period: float) -> None:
        self.period = period
        self._stepped = 0.0, 0.0

    def due(self, reading: HeadReading) -> bool:
        """Whether to take a step now, that the joints were read."""
        before, measured = self._stepped
        passed, newer = reading.now - before, reading.stamp - measured
        if 0.0 <= passed < 0.5 * self.period:
            return False  # joint states that were held up come all at once; or time stands still
        if 0.0 <= newer < 0.75 * self.period and 0.0 <= passed < 1.5 * self.period:
            return False  # joints are measured more often
        self._stepped = reading.now, reading.stamp
        return True


class HeadTurner(Protocol):
    """What a node decides about the head that it turns; asked with the interface's lock held."""

    what: str
    """What it does, such as "tracking"."""

    def head_known(self, head: PanTiltHead, base: HeadBase | None) -> None:
        """The robot's model is there, or has changed.

        Args:
            head: of the model.
            base: where the head's base is, unless that is the frame that stands still.
        """

    def reset(self, reason: str) -> None:
        """The clock has jumped or stopped: what was made of times before is worth nothing."""

    def step(self, reading: HeadReading) -> HeadCommand | None:
        """What to do now; nothing is sent while it is off."""

    def halt(self, reading: HeadReading | None) -> HeadCommand | None:
        """The command that stops the head because somebody switches the node off."""

    def recenter(self, reading: HeadReading) -> str:
        """Turns the head to its centre; what follows, for whoever asked."""

    def switched(self) -> None:
        """It turns the head from now on, or not any more; the interface's `off` says why not."""

    def report(self) -> None:
        """Tells others what it does, if that has changed."""


class HeadInterface:
    """Connects a node to the head that it turns: one of the controllers of its process.

    In a process with the servo bus its `step` is asked in each cycle of the bus, in the bus's
    thread, and what it answers is written in the same cycle. Alone in a process it is asked when
    `joint_states` come, and what it answers is published on `joint_commands`.

    Args:
        node: subscribes `target_point`, and publishes `~/enabled`.
        pointing_frame: the frame to point.
        error_topic: where the angle by which the head misses its target goes [rad].
        buffer: fed by another node of this process; None: this node listens itself.
        loop: of this process; None: there is none.
        turner: the node's side of it.

    Raises:
        ValueError: a parameter is not allowed.

    Attributes:
        name: the node's.
        joints: pan and tilt.
        trouble: why the head is left alone; empty: nothing keeps it from moving.
        unheard: which publishers of targets cannot be heard, and why; empty: none.
        lock: held while the turner is asked anything.
        slow: there was a STOP, and the head goes slowly until it has arrived.
        buffer: the robot's frames.
        head: the head that is turned, once the robot's model is known.
        newest_target: as it was sent, once one could be placed.
    """

    failure: Exception | None = None

    def __init__(
        self,
        node: Node,
        pointing_frame: str,
        error_topic: str,
        buffer: Buffer | None,
        loop: ControlLoop | None,
        turner: HeadTurner,
    ) -> None:
        self.trouble = "waiting for robot_description"
        self.lock = threading.RLock()
        self._changing = threading.Lock()
        self.slow = False
        self.unheard = ""
        self.newest_target: Target | None = None
        self.head: PanTiltHead | None = None
        self._node = node
        self._log = node.get_logger()
        self._parameters = NodeParameters(node, HeadParameters).value
        self.name = str(node.get_fully_qualified_name())
        self.joints = self._parameters.head_pan_joint, self._parameters.head_tilt_joint
        self._pointing_frame = pointing_frame
        self._turner = turner
        self._clock = ClockWatch(lambda: float(node.get_clock().now().nanoseconds) * 1e-9)
        self._model: RobotModel | None = None
        self._refused_model: RobotModel | None = None
        self._told: dict[str, float] = {}
        self._carried: dict[str, bool] = {}
        self._base_frame = ""
        self._base: HeadBase | None = None
        self._placer: TargetPlacer | None = None
        self._listening_since = round(self.now * 1e9)
        self._inbox: deque[tuple[Target, float]] = deque(maxlen=_MOST_WAITING)
        self._placed: deque[tuple[float, Vector3]] = deque(maxlen=_MOST_WAITING)
        self._positions = (0.0, 0.0)
        self._error: float | None = None
        self._errors = Output(node, Float64, error_topic)
        self._enabled_topic = node.create_publisher(Bool, "~/enabled", LATCHED)
        self._state_topic = node.create_publisher(String, "~/state", LATCHED)
        self._status_topic = node.create_publisher(DiagnosticStatus, "~/status", LATCHED)
        self._last_state: tuple[str, Mapping[str, str]] = "", {}
        TopicListener(node, PointStamped, "target_point", self._on_message)
        node.create_service(SetBool, "~/enable", self._on_enable)
        node.create_service(Trigger, "~/recenter", self._on_recenter)
        if loop is None:
            buffer = buffer or Buffer(node=node)
            loop = ControlLoop(buffer.core)
            listen_for(loop, buffer, node)
        self._loop = loop
        self._disabled = "it has not begun"
        assert loop.buffer is not None
        self.buffer = loop.buffer
        self._epoch = loop.owners.epoch.value
        self._seen = self._applied = self.off, self._epoch
        self._trajectory: TrajectoryOutput | None = None
        self._topics: JointTopics | None = None
        if self._parameters.command_interface == "joint_trajectory":
            self._drive_by_trajectory()
        elif loop.write is None:
            self._topics = JointTopics(node, self.name, self.joints, loop)

    def _drive_by_trajectory(self) -> None:
        if self._loop.write is not None:
            raise HeadTrackingError(
                "command_interface is joint_trajectory, but the servo bus runs in this process; "
                f"start {self._node.get_name()} alone (ros2 run head_tracking "
                f"{self._node.get_name()}), or leave command_interface out"
            )
        self._trajectory = TrajectoryOutput(
            self._node,
            self._parameters.command_topic,
            self.joints,
            self._parameters.time_from_start,
            self._loop,
        )
        self._log.info(
            f"the head is driven by {self._trajectory.topic}; stop holds it and relaxes nothing"
        )

    def close(self) -> None:
        """Offers nothing any more."""
        if self._trajectory is not None:
            self._trajectory.close()

    def begin(self) -> None:
        """Turn the head from now on, unless another node of this process does."""
        owners = self._loop.owners
        try:
            owners.claim(self.name, self.joints)
        except (OwnershipError, StoppedError) as error:
            self._disabled = str(error)
            self._log.warning(f"{error}; until then this node is disabled")
        self._seen = self._applied = self.off, owners.epoch.value
        owners.observe(self._owners_changed)
        self._enabled_topic.publish(Bool(data=not self.off))
        if self.buffer.model is not None:
            self._check_model()
        self._loop.target_takers.append(self._take_target)
        self._loop.add(self)
        steady_timer(self._node, _WATCH_PERIOD, self._watch)
        steady_timer(self._node, _TELL_PERIOD, self._look_for_unheard)

    @property
    def off(self) -> str:
        """Why the node does not turn the head; empty: it does, for it owns the joints."""
        owners = self._loop.owners
        if owners.owns(self.name, self.joints):
            return ""
        return STOPPED if owners.stopped else self._disabled

    def update(self) -> None:
        """Asks the turner what to do now, and does it; see `ControlLoop`."""
        with self.lock:
            reading = self.reading()
            self._apply_change()
            if self._placer is not None:
                while self._inbox:
                    self._placer.offer(*self._inbox.popleft())
            if reading is not None:
                self.send(self._turner.step(reading))
                if self._trajectory is not None and not self.off:
                    self._trajectory.take(None, reading.positions, reading.now)

    def publish(self) -> None:
        """Tells others of the error."""
        error, self._error = self._error, None
        if error is not None and self._errors.wanted:
            self._errors.publish(Float64(data=error))
        with self.lock:
            self._turner.report()

    def disable(self, reason: str) -> None:
        """Give the joints up, also after a STOP has ended."""
        self._disabled = reason
        self._loop.owners.release(self.name)

    def _owners_changed(self) -> None:
        """React to another owner of the joints, or to a STOP; for any thread."""
        try:
            self._follow_owners()
        except Exception as error:
            # no STOP fails of it; whoever runs the node ends the program
            self.failure = error

    def _follow_owners(self) -> None:
        owners = self._loop.owners
        with self._changing:
            before, now = self._seen, (self.off, owners.epoch.value)
            others = set(owners.of(self.joints).values()) - {"", self.name}
            lost = bool(now[0] and not before[0] and others)
            if lost:
                self._disabled = f"{' and '.join(sorted(others))} has taken the head over"
                now = self._disabled, now[1]
            self._seen = now
            self.slow |= now[1] != before[1]
        if now == before:
            return
        if lost:
            owners.release(self.name)  # the other joint, too
        if self._trajectory is not None:
            self._trajectory.hold()
        # a turner that hangs must not keep others from stopping the head
        if self.lock.acquire(timeout=_PATIENCE):
            try:
                self._apply_change()
            finally:
                self.lock.release()
        if bool(now[0]) is not bool(before[0]):
            self._enabled_topic.publish(Bool(data=not self.off))

    def _apply_change(self) -> None:
        """Let the turner know; with the lock held."""
        if self._applied != self._seen:
            self._applied = self._seen
            self.forget_targets()
            self._turner.switched()

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        what = self._turner.what
        response.success = True
        if request.data:
            try:
                self._enable()
                response.message = f"{what} is on"
            except StoppedError as error:
                response.success, response.message = False, str(error)
            return response
        with self.lock:
            reading = self.reading()
            if not self.off:
                self.send(self._turner.halt(reading))
        self.disable(f"{what} is switched off")
        response.message = f"{what} is off; the head stops"
        return response

    def _enable(self) -> None:
        """Take the joints over, whoever owns them.

        Raises:
            StoppedError: the head is stopped.
        """
        epoch = self._loop.owners.permit()
        if self.off:
            self._loop.owners.take_over(self.name, self.joints, epoch)
            if self._topics is not None:
                self._topics.claim()

    def _on_recenter(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        with self.lock:
            reading = self.reading()
            if reading is None or self.off:
                response.message = self.off or "there is no model or no joint state"
                return response
            self.forget_targets()
            response.success, response.message = True, self._turner.recenter(reading)
        return response

    def _watch(self) -> None:
        with self.lock:
            self.reading()
            self._turner.report()

    def _look_for_unheard(self) -> None:
        self.unheard = unheard(self._node, PointStamped, "target_point")
        if self.unheard:
            self._tell("unheard", self.unheard)

    def take_placed(self) -> list[tuple[float, Vector3]]:
        """The targets of this node since this was asked last: stamp [s], point in the base [m]."""
        placed = []
        while self._placed:
            stamp, point = self._placed.popleft()
            base = self._base
            placed.append((stamp, point if base is None else base.at(stamp).inverse() @ point))
        return placed

    @property
    def obstacle(self) -> str:
        """Why nothing that is sent now would turn the head; empty: it would."""
        owner = self._topics.owner if self._topics is not None else ""
        if not self.off and owner not in ("", self.name):
            return f"the joints belong to {owner}"
        return self.off or self.trouble

    @property
    def stuck(self) -> str:
        """Why a joint cannot go where it is told, as this process's servo bus has found out."""
        return "; ".join(filter(None, map(self._loop.stuck.get, self.joints)))

    def set_out(self) -> None:
        """Begins a motion: what was found out about joints until now counts no more."""
        for joint in self.joints:
            self._loop.stuck.pop(joint, None)

    @property
    def period(self) -> float:
        """Of the loop [s]; 0: not known."""
        return self._loop.period

    @property
    def transform_timeout(self) -> float:
        """How long a target waits for its transforms [s]."""
        return self._parameters.transform_timeout

    def pointing(self, frame: str, axis: tuple[float, float, float]) -> PanTiltHead:
        """The head, as it points another frame.

        Args:
            frame: any that it carries; empty: the node's own.
            axis: the direction in it to point; all 0: the usual one of that frame.

        Raises:
            RobotModelError: that cannot be pointed.
        """
        assert self._model is not None
        assert self.head is not None
        frame = frame or self._pointing_frame
        if not any(axis) and frame == self._pointing_frame:
            return self.head
        return self._parameters.head(self._model, frame, axis)

    def fixed_place(self, target: Target, positions: tuple[float, float]) -> Vector3:
        """A target that moves with the head, in `fixed_frame`, as it was at its stamp.

        Raises:
            TransformException: nobody knows, or not yet.
        """
        assert self._placer is not None
        return self._placer.place_one(self._dated(target), self._named(positions))

    def from_base(self, point: Vector3, now: float) -> Vector3:
        """A point of `fixed_frame`, in the head's base frame as that is now.

        Raises:
            TransformException: nobody knows where the base is.
        """
        if self._base is None:
            return point
        unknown = self._base.update()
        if unknown:
            raise TransformException(unknown)
        return self._base.pose(now).inverse() @ point

    def newest_place(self, target: Target) -> tuple[Vector3, float | None]:
        """A target in the head's base frame by the newest transforms, and when that was [s].

        None: it never moves there.

        Raises:
            TransformException: nobody knows.
        """
        found = self.buffer.lookup_transform(self._base_frame, target.frame_id, LATEST)
        stamp = None if found.stamp == LATEST else found.stamp * 1e-9
        return found.transform @ target.point, stamp

    @property
    def now(self) -> float:
        """The time [s] on the node's clock."""
        return self._clock.now(simulated=self._simulated)

    def reading(self) -> HeadReading | None:
        """The head as measured; None without a robot or a fresh measurement.

        Before, the clock and the robot's model are looked at. What is missing stands in `trouble`
        and in the log.
        """
        self._epoch = self._loop.owners.epoch.value
        self._check_clock()
        self._check_model()
        if self._placer is None:
            return None
        p, now = self._parameters, self._clock.checked
        found, stamps = [], []
        for joint in (p.head_pan_joint, p.head_tilt_joint):
            stamp, position = self.buffer.latest_joint_position(joint) or (-1, None)
            age = now - (self._listening_since if stamp < 0 else stamp) * 1e-9
            if abs(age) > p.joint_state_timeout:
                self.trouble = self._clock.standing or (
                    f"no position of {joint} in joint_states: the head is left alone"
                    if age > 0.0
                    else f"the positions of {joint} in joint_states lie in the future (the clocks "
                    "of their sender and of this machine differ): the head is left alone"
                )
                self._tell(joint, f"{self.trouble} (by {abs(age):.1f} s)")
                return None
            if position is None:
                self.trouble = self._clock.standing or f"waiting for {joint} in joint_states"
                return None
            found.append(position)
            stamps.append(stamp)
        self.trouble = self._clock.standing
        self._positions = found[0], found[1]
        return HeadReading(now, min(stamps) * 1e-9, (found[0], found[1]))

    def take_targets(
        self, positions: tuple[float, float], now: float
    ) -> list[tuple[Target, Vector3]]:
        """New targets and their places in the fixed frame; see `TargetPlacer.place`.

        Args:
            positions: pan and tilt [rad] at which a target that is meant for now is placed.
            now: the time [s].
        """
        assert self._placer is not None
        placed = self._placer.place(now, self._named(positions))
        for target, point in placed:
            self._keep(target, point, now)
        return placed

    def take_newest_target(
        self, positions: tuple[float, float], now: float
    ) -> tuple[Target, Vector3] | None:
        """The newest target only, and its place in the head's base frame as that is now."""
        assert self._placer is not None
        placed = self._placer.place_newest(now, self._named(positions))
        if placed is None:
            return None
        self._keep(*placed, now)
        if self._base is None:
            return placed
        unknown = self._base.update()
        if unknown:
            self.refuse(Refusal(placed[0], unknown))
            return None
        return placed[0], self._base.pose(now).inverse() @ placed[1]

    def take_refusal(self) -> str:
        """Why a target has led to nothing since this was asked last; empty if none has."""
        assert self._placer is not None
        refusal = self._placer.take_refusal()
        return self.refuse(refusal) if refusal else ""

    def moves_with_head(self, frame_id: str) -> bool:
        """Whether a frame is carried by the head."""
        if frame_id not in self._carried:
            frames = self._base_frame, frame_id
            here, there = self._named((0.0, 0.0)), self._named((0.1, 0.1))
            try:
                one = self.buffer.lookup_transform(*frames, LATEST, joint_positions=here)
                other = self.buffer.lookup_transform(*frames, one.stamp, joint_positions=there)
            except TransformException:
                return False
            self._carried[frame_id] = one.transform != other.transform
        return self._carried[frame_id]

    def send(self, command: HeadCommand | None) -> None:
        """Takes a command for both joints to the servos, if there is one and the head is ours."""
        if command is None or self.off or self._epoch != self._loop.owners.epoch.value:
            return
        if self._trajectory is not None:
            self._trajectory.take(command, self._positions, self.now)
            return
        pan, tilt = self.joints
        goals = {
            pan: Goal(command.pan, command.pan_speed),
            tilt: Goal(command.tilt, command.tilt_speed),
        }
        assert self._loop.write is not None
        self._loop.write(self.name, goals, self._epoch)

    def publish_state(self, state: str, text: str) -> bool:
        """Publish what the node does, if it has changed; return whether the text has.

        Args:
            state: in a word, for programs: the field `state` of `~/status`.
            text: in a sentence, for `~/state`.
        """
        text = "; ".join(filter(None, (text, self.unheard)))
        off = self.off
        fields = {
            "state": state,
            "enabled": str(not off).lower(),
            "stopped": str(self._loop.owners.stopped).lower(),
            "slow": str(self.slow).lower(),
            "disabled because": off,
            "trouble": self.trouble,
            "not heard": self.unheard,
        }
        before, self._last_state = self._last_state, (text, fields)
        if fields != before[1] or text != before[0]:
            hampered = off or self.trouble or self.unheard
            self._status_topic.publish(
                DiagnosticStatus(
                    level=DiagnosticStatus.WARN if hampered else DiagnosticStatus.OK,
                    name=self.name,
                    message=text,
                    values=[KeyValue(key=key, value=value) for key, value in fields.items()],
                )
            )
        if text != before[0]:
            self._state_topic.publish(String(data=text))
        return text != before[0]

    def tell_error(self, error: float | None) -> None:
        """Lets others know by how much the head misses its target [rad], if it has one."""
        self._error = error

    def forget_targets(self) -> None:
        """Drops targets that wait for their transforms."""
        self._inbox.clear()
        if self._placer is not None:
            self._placer.forget()

    def refuse(self, refusal: Refusal) -> str:
        """Logs that a target leads to nothing; why."""
        target, reason = refusal
        self._tell(f"target in {target.frame_id}", f"target {target} refused: {reason}")
        return reason

    @property
    def _simulated(self) -> bool:
        return bool(self._node.get_clock().ros_time_is_active)

    def _check_clock(self) -> None:
        happened = self._clock.check(simulated=self._simulated)
        now = round(self._clock.checked * 1e9)
        self._listening_since = self._listening_since or now
        if happened:
            self._log.warning(f"{happened}: everything starts anew, and the head holds")
            self._listening_since = now
            if not self._clock.standing:
                self.buffer.clear()
            self.forget_targets()
            self._turner.reset(happened)

    def _check_model(self) -> None:
        model = self.buffer.model
        if model is not None and model is not self._model and model is not self._refused_model:
            try:
                self._take_model(model)
            except RobotModelError as error:
                self._refused_model = model
                if self._model is not None:
                    self.buffer.set_model(self._model)
                    self._log.error(f"another robot_description is not used: {error}")
                else:
                    self.trouble = f"robot_description cannot be used: {error}"
        if self._placer is None:
            self._tell("model", self.trouble)

    def _take_model(self, model: RobotModel) -> None:
        p = self._parameters
        head = p.head(model, self._pointing_frame)
        fixed_frame = p.fixed_frame or head.base_frame
        if fixed_frame in model.links and any(
            joint.name in (head.pan_joint, head.tilt_joint)
            for joint in model.joints_above(fixed_frame)
        ):
            raise RobotModelError(
                f"fixed_frame is {fixed_frame!r}, which moves with the head; choose a frame that "
                f"stands still, such as {head.base_frame} or odom"
            )
        self._model = model
        self._base_frame = head.base_frame
        self._carried.clear()
        self._placer = TargetPlacer(self.buffer, fixed_frame, p.transform_timeout)
        self._base = (
            None
            if fixed_frame == head.base_frame
            else HeadBase(self.buffer, fixed_frame, head.base_frame)
        )
        self.head = head
        self._turner.head_known(head, self._base)

    def _on_message(self, message: PointStamped) -> None:
        self._take_target(target_from_message(message))

    def _take_target(self, target: Target) -> None:
        """Keeps a target for the next cycle; for any thread."""
        if self._placer is not None:
            self._inbox.append((self._dated(target), self.now))

    def _keep(self, target: Target, point: Vector3, now: float) -> None:
        """Remembers where a target was, for those who look on."""
        self.newest_target = target
        self._placed.append((target.stamp * 1e-9 if target.stamp else now, point))

    def _named(self, positions: tuple[float, float]) -> dict[str, float]:
        p = self._parameters
        return {p.head_pan_joint: positions[0], p.head_tilt_joint: positions[1]}

    def _tell(self, about: str, text: str) -> None:
        """Logs a warning, but not the same thing again and again."""
        now = time.monotonic()
        if now - self._told.get(about, -math.inf) >= _TELL_PERIOD:
            if len(self._told) >= _MOST_TOLD:
                self._told.clear()
            self._told[about] = now
            self._log.warning(text)

    def _dated(self, target: Target) -> Target:
        latency = round(self._parameters.target_latency * 1e9)
        return replace(target, stamp=max(1, target.stamp - latency)) if target.stamp else target
