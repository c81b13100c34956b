"""The robot as the page sees it: over ROS topics, services and parameters."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import JointState as JointStateMsg

from head_tracking.dynamixel import Torque
from head_tracking.gaze import PanTiltHead
from head_tracking.ros.head_interface import HeadParameters
from head_tracking.ros.placed_target import NewestTarget
from head_tracking.tf import Buffer
from head_tracking.transforms import (
    RobotModel,
    RobotModelError,
    Transform,
    TransformException,
    Vector3,
)
from head_tracking.viewer.free_joints import FreeJoints
from head_tracking.viewer.head_modes import CAMERA, FICTITIOUS, POINTER, TRACKER, HeadModes
from head_tracking.viewer.robot import Health, Level, Mode, Observation, Outcome, Servo, Setting
from head_tracking.viewer.running_parameters import RunningParameters
from head_tracking.viewer.running_services import RunningServices
from head_tracking.viewer.running_topics import RunningTopics

_LOOK_PERIOD = 1.0  # s
_TARGET_AGE = 2.0  # s
_PATIENCE = 2.0  # s
_TORQUES = {torque.value for torque in Torque}
_ENDINGS = (
    *("/torque_enable", "/relax", "/recenter", "/enable", "/recover"),
    *(f"/node_starter/{name}" for name in (TRACKER, POINTER, FICTITIOUS, CAMERA)),
)


class ViewerRobot:
    """Implements `head_tracking.viewer.robot.Robot`.

    Args:
        node: listens to what comes often, and speaks. Another thread than the page's must spin it.
        requests: looks for services, parameters and topics, and calls them; a node of its own,
            because each of its many clients would slow down every wake-up of the other one.
        buffer: the robot's frames.
        head_parameters: which joints make up the head.
        pointing_frame: the frame that looks.
    """

    def __init__(
        self,
        node: Node,
        requests: Node,
        buffer: Buffer,
        head_parameters: HeadParameters,
        pointing_frame: str,
    ) -> None:
        self._node = node
        self._buffer = buffer.core
        self._head_parameters = head_parameters
        self._pointing_frame = pointing_frame
        self._model: RobotModel | None = None
        self._head: PanTiltHead | None = None
        self._no_head = ""
        self._targets = NewestTarget(node, self._buffer)
        self._free = FreeJoints(node)
        self._services = RunningServices(requests)
        self._parameters = RunningParameters(
            requests, [node.get_fully_qualified_name(), "/run_monitor", "/node_starter"]
        )
        self._topics = RunningTopics(node)
        self._modes = HeadModes(node, self._services, self._buffer, self._parameters.nodes)
        self._commands = node.create_publisher(JointStateMsg, "joint_commands", 10)
        self._joint_watch = JointWatch()
        requests.create_timer(_LOOK_PERIOD, self._look)
        node.create_timer(_LOOK_PERIOD, self._topics.look)

    # what it is

    def model(self) -> RobotModel | None:
        """The robot's model; its head is made anew with it."""
        model = self._buffer.model
        if model is not self._model and model is not None:
            try:
                self._head, self._no_head = (
                    self._head_parameters.head(model, self._pointing_frame),
                    "",
                )
            except (RobotModelError, TransformException) as error:
                self._head, self._no_head = None, f"no head is shown: {error}"
            self._targets.place_in(model.root)
            self._model = model
        return model

    def head(self) -> PanTiltHead | None:
        """The head that is turned; None if the model has none."""
        return self._head

    def notices(self) -> tuple[str, ...]:
        """Why there is no head, if there is none."""
        return (self._no_head,) if self._no_head else ()

    def frames(self) -> tuple[str, ...]:
        """Names of all frames."""
        return self._buffer.frames()

    def observe(self) -> Observation:
        """The newest of everything; never waits."""
        model = self._model
        if model is None:
            return Observation(self._now)
        joints = {
            name: found[1]
            for name in model.independent_joints
            if (found := self._buffer.latest_joint_position(name)) is not None
        }
        target = self._targets.newest(self._keep_target)
        return Observation(
            self._now,
            joints,
            self._outer_frames(model),
            None if target is None else target.point,
            "" if target is None else str(target.target),
            self._topics.error(),
            self._topics.state(),
            None if target is None else target.stamp,
            self._silent_joints(),
            self._modes.missing(),
        )

    def health(self) -> tuple[Health, ...]:
        """The newest diagnostics, by name; not those of a tracker that is not needed any more."""
        return tuple(
            one
            for one in self._topics.health()
            if not (
                one.level is Level.STALE
                and one.name.startswith(TRACKER)
                and self.mode() is Mode.POINT
            )
        )

    def warnings(self) -> tuple[str, ...]:
        """What nodes warned of, newest last."""
        return self._topics.warnings()

    def servos(self) -> tuple[Servo, ...]:
        """The servos whose torque can be switched."""
        joints: dict[str, str] = {}
        for owner in self._parameters.nodes():
            for name, joint in self._parameters.fixed(owner, "_controller.joint_name").items():
                joints[name.removesuffix(".joint_name")] = str(joint)
        torque = {
            _joint_of(one): Torque(one.values["torque"])
            for one in self.health()
            if one.values.get("torque") in _TORQUES
        }
        found = []
        for service in self._services.names("_controller/torque_enable"):
            controller = service.split("/")[-2]
            joint = joints.get(controller, "")
            known = torque.get(joint)
            holds = None if known is None else known is Torque.ON
            found.append(Servo(controller, joint, holds, known is not None and known.waits))
        return tuple(found)

    def settings(self) -> tuple[Setting, ...]:
        """Parameters that can be changed while their nodes run."""
        return self._parameters.settings()

    def images(self) -> tuple[str, ...]:
        """Topics with pictures."""
        return self._topics.images()

    def picture(self, topic: str) -> Any:
        """The newest picture of a topic."""
        return self._topics.picture(topic)

    def can_start_camera(self) -> bool:
        """Whether the run can simulate a camera and does not yet."""
        return self._modes.can_start(CAMERA)

    def start_camera(self) -> Outcome:
        """Starts it."""
        return self._modes.start(CAMERA)

    def mode(self) -> Mode | None:
        """What decides where the head looks."""
        return self._modes.mode()

    def tracking(self) -> bool | None:
        """Whether the tracker turns the head."""
        return self._modes.tracking()

    def free_joints(self) -> bool:
        """Whether nobody but this node sends joint states, and no servos were ever there."""
        return self._free.free

    # what it does

    def look_at(self, frame: str, point: Vector3) -> Outcome:
        """Sends a target once, or again and again where a tracker needs that."""
        return self._modes.look_at(frame, point)

    def centre(self) -> Outcome:
        """Recentres with the node that turns the head now."""
        return self._modes.centre()

    def set_mode(self, mode: Mode, frame: str) -> Outcome:
        """Switches the nodes that send targets and turn the head; starts those it needs."""
        return self._modes.set_mode(mode, frame)

    def set_tracking(self, on: bool) -> Outcome:
        """Switches the tracker on or off."""
        return self._modes.set_tracking(on)

    def set_value(self, node: str, name: str, value: Any) -> Outcome:
        """Sets a parameter."""
        return self._parameters.set(node, name, value)

    def move_joints(self, positions: Mapping[str, float]) -> Outcome:
        """Moves joints of servos; without hardware, says itself where joints are.

        All go into one message: of several, whoever drives the servos takes the newest.
        """
        if self.free_joints() and self._model is not None:
            self._free.put(self._model, positions)
            return Outcome(True, "")
        said = ""
        if self.tracking() and self.mode() is not Mode.POINT:
            outcome = self.set_tracking(False)
            if not outcome.done:
                return outcome
            said = "tracking was switched off to move joints by hand"
        message = JointStateMsg(
            name=list(positions), position=[float(position) for position in positions.values()]
        )
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._commands.publish(message)
        return Outcome(True, said)

    def set_torque(self, controller: str, on: bool) -> Outcome:
        """Lets a servo hold or go; all of them for an empty name."""
        ending = f"/{controller}/torque_enable" if controller else "/torque_enable"
        names = self._services.names(ending)
        if not controller:
            names = tuple(name for name in names if not name.endswith("_controller/torque_enable"))
        return self._all(names, lambda name: self._services.switch(name, on), "torque_enable")

    def recover(self) -> Outcome:
        """Clears the faults of servos, where the bus can."""
        return self._all(self._services.names("/recover"), self._services.trigger, "recover")

    def can_recover(self) -> bool:
        """Whether a bus offers to clear faults."""
        return bool(self._services.names("/recover"))

    def stop(self) -> Outcome:
        """Relaxes all servos of all buses, and sends no more targets."""
        self._modes.stop_sending()
        return self._all(self._services.names("/relax"), self._services.trigger, "relax")

    # inside

    @property
    def _now(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)

    def _all(self, names: tuple[str, ...], call: Callable[[str], Outcome], what: str) -> Outcome:
        if not names:
            return Outcome(False, f"nobody offers {what}: is a servo_bus running?")
        outcomes = [call(name) for name in names]
        return Outcome(
            all(outcome.done for outcome in outcomes), "; ".join(one.text for one in outcomes)
        )

    def _outer_frames(self, model: RobotModel) -> Mapping[str, Transform]:
        found = {}
        for frame in self._buffer.frames():
            if frame not in model.children_of_joints and frame != model.root:
                try:
                    found[frame] = self._buffer.lookup_transform(model.root, frame).transform
                except TransformException:
                    continue
        return found

    def _silent_joints(self) -> tuple[str, ...]:
        """Joints of the head that somebody should tell and nobody does."""
        head = self._head
        joints = () if head is None or self.free_joints() else (head.pan_joint, head.tilt_joint)
        newest = {joint: self._buffer.latest_joint_position(joint) for joint in joints}
        return self._joint_watch.silent(
            {joint: None if found is None else found[0] for joint, found in newest.items()}
        )

    @property
    def _keep_target(self) -> float:
        """A pointed head keeps its target; one that tracks needs it anew [s]."""
        return math.inf if self.mode() is Mode.POINT else _TARGET_AGE

    def _look(self) -> None:
        """Finds out what is there now."""
        self._services.look(lambda name: name.endswith(_ENDINGS))
        self._parameters.look()
        self._free.look(servos=bool(self._services.names("_controller/torque_enable")))


class JointWatch:
    """Notices joints that fall silent.

    By the clock of this machine: stamps may be on another one, or stand still with it.

    Args:
        clock: time that never jumps [s].
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._heard: dict[str, tuple[int | None, float]] = {}

    def silent(self, stamps: Mapping[str, int | None]) -> tuple[str, ...]:
        """The joints whose newest stamp has not changed for a while.

        Args:
            stamps: the newest of each joint that somebody should tell [ns]; None: never told.
        """
        now = self._clock()
        for joint in self._heard.keys() - stamps.keys():
            del self._heard[joint]
        for joint, stamp in stamps.items():
            if joint not in self._heard or self._heard[joint][0] != stamp:
                self._heard[joint] = stamp, now
        return tuple(joint for joint in stamps if now - self._heard[joint][1] > _PATIENCE)


def _joint_of(health: Health) -> str:
    """The joint that a servo's diagnostics are about."""
    return health.name.removeprefix("servo_bus: ").partition(" (servo ")[0]
