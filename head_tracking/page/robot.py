"""The robot on the page: what its panels use, over topics, services and parameters."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress

from rclpy.exceptions import InvalidHandle
from rclpy.node import Node

from head_tracking.gaze import PanTiltHead
from head_tracking.head.head_parameters import HeadParameters
from head_tracking.page.badge import Badge, badge
from head_tracking.page.head_modes import (
    POINTER,
    TRACKER,
    HeadModes,
    Mode,
    OtherNodes,
)
from head_tracking.page.joint_control import JointControl
from head_tracking.page.other_topics import OtherTopics
from head_tracking.page.stop import Stop
from head_tracking.recording.recorder import Recorder, RecorderParameters
from head_tracking.recording.recording import Observation, known_joints, outer_frames
from head_tracking.ros.kit.diagnostics import Health
from head_tracking.ros.kit.graph import Graph
from head_tracking.ros.kit.other_parameters import OtherParameters
from head_tracking.ros.kit.other_services import OtherServices, Outcome
from head_tracking.ros.kit.own_thread import OwnThread
from head_tracking.ros.targets.placed_target import NewestTarget
from head_tracking.tf import Buffer
from head_tracking.transforms import (
    RobotModel,
    RobotModelError,
    TransformException,
)

_LOOK_PERIOD = 1.0  # s
_TARGET_AGE = 2.0  # s
_PATIENCE = 2.0  # s
_GONE = 60.0  # s: a frame, such as a person's, that has been silent for so long is left out
_STOPPED = 0.5  # s in which a bus that knows `stop` says that it is stopped
_POLL = 0.01  # s


class Robot:
    """One robot: that of the node's namespace.

    Args:
        node: listens to what comes often, and speaks. Another thread than the page's must spin it.
        buffer: the robot's frames.
        head_parameters: which joints make up the head.
        pointing_frame: the frame that looks.
        recorder_parameters: where recordings go.

    Attributes:
        buffer: the robot's frames.
        stop: STOP and resume; shares nothing with the rest.
        topics: what other nodes say.
        parameters: what can be tuned.
        modes: what decides where the head looks.
        joints: joints by hand.
        recorder: writes everything that the robot says into files.
    """

    def __init__(
        self,
        node: Node,
        buffer: Buffer,
        head_parameters: HeadParameters,
        pointing_frame: str,
        recorder_parameters: RecorderParameters = RecorderParameters(),  # noqa: B008, it is frozen
    ) -> None:
        self._node = node
        self.buffer = buffer.core
        self._head_parameters = head_parameters
        self._pointing_frame = pointing_frame
        self._model: RobotModel | None = None
        self._head: PanTiltHead | None = None
        self._no_head = ""
        self.stop = Stop(node)
        # each of its many clients would slow down every wake-up of the other node
        self._requests = OwnThread(node, f"{node.get_name()}_requests")
        requests = self._requests.node
        self._graph = Graph(node)
        self._targets = NewestTarget(node, self.buffer)
        self.topics = OtherTopics(node, self._graph)
        services = OtherServices(requests)
        self.parameters = OtherParameters(
            requests, self._graph, (node.get_name(), "run_monitor", "node_starter")
        )
        self.recorder = Recorder(
            node,
            self._graph.is_below,
            recorder_parameters,
            self.buffer,
            self.parameters.values,
        )
        others = OtherNodes(
            services, self.topics, self._graph, self.parameters, self.buffer, self.stop
        )
        self.modes = HeadModes(node, others)
        self.joints = JointControl(node, others, self.modes)
        self._joint_watch, self._frame_watch = SilenceWatch(_PATIENCE), SilenceWatch(_GONE)
        requests.create_timer(_LOOK_PERIOD, self._look)
        node.create_timer(_LOOK_PERIOD, self.topics.look)
        self._requests.start()

    def close(self) -> None:
        """Ends what the page asks of others; the robot goes on as it is."""
        self.recorder.close()
        self._requests.close()
        self.stop.close()

    def model(self) -> RobotModel | None:
        """The robot's model; its head is made anew with it."""
        model = self.buffer.model
        if model is not self._model and model is not None:
            self._head = self.head_of(model)
            self._targets.place_in(model.root)
            self._model = model
        return model

    def head_of(self, model: RobotModel) -> PanTiltHead | None:
        """Return the head of a model; None if it has none."""
        try:
            head = self._head_parameters.head(model, self._pointing_frame)
        except (RobotModelError, TransformException) as error:
            self._no_head = f"no head is shown: {error}"
            return None
        self._no_head = ""
        return head

    def head(self) -> PanTiltHead | None:
        """The head that is turned; None if the model has none."""
        return self._head

    def notices(self) -> tuple[str, ...]:
        """What a person should know of the set-up."""
        return tuple(filter(None, (self._no_head, self.modes.fighting())))

    def observe(self, *, watched: bool = True) -> Observation:
        """Return the latest of everything; never wait.

        Args:
            watched: somebody looks; False: without the error, which is published in each cycle.
        """
        model = self._model
        if model is None:
            return Observation(self._now)
        mode = self.modes.mode()
        turner = POINTER if mode is Mode.POINT else TRACKER
        # a pointed head keeps its target; one that tracks needs it anew
        target = self._targets.newest(math.inf if mode is Mode.POINT else _TARGET_AGE)
        state = "" if mode is Mode.OFF else self.topics.state(turner)
        return Observation(
            self._now,
            known_joints(self.buffer, model),
            outer_frames(self.buffer, model, self._frame_watch.silent(self.buffer.latest_stamps())),
            None if target is None else target.point,
            "" if target is None else str(target.target),
            None if mode is Mode.OFF or not watched else self.topics.error(turner),
            f"{turner}: {state}" if state else "",
            None if target is None else target.stamp,
            self._silent_joints(),
            self.modes.missing(),
        )

    def badge(self, live: Observation) -> Badge:
        """What the robot does, in a word; see `badge.badge`."""
        mode = self.modes.mode()
        return badge(
            live,
            self.health(),
            self.joints.servos(),
            stopped=self.stop.stopped,
            on=mode is not Mode.OFF,
            complaint=self.topics.complaint(POINTER) if mode is Mode.POINT else "",
        )

    def health(self) -> tuple[Health, ...]:
        """The latest diagnostics, by name."""
        return self.topics.health()

    def stop_everything(self) -> Outcome:
        """Relaxes all servos, and ends what turned the head; says within 0.5 s how it went."""
        outcome = self.stop.stop()
        threading.Thread(target=self._rest, daemon=True).start()
        return outcome

    def _rest(self) -> None:
        """Switches off what turns the head, unless the bus does so until `resume`."""
        deadline = time.monotonic() + _STOPPED
        while not self.stop.stopped and time.monotonic() < deadline:
            time.sleep(_POLL)
        if not self.stop.stopped:
            with suppress(InvalidHandle):  # the page may have ended meanwhile
                self.modes.set_mode(Mode.OFF)

    @property
    def _now(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)

    def _silent_joints(self) -> tuple[str, ...]:
        """Joints of the head that somebody should tell and nobody does."""
        head = self._head
        joints = () if head is None or self.joints.free else (head.pan_joint, head.tilt_joint)
        newest = {joint: self.buffer.latest_joint_position(joint) for joint in joints}
        return self._joint_watch.silent(
            {joint: None if found is None else found[0] for joint, found in newest.items()}
        )

    def _look(self) -> None:
        """Finds out what is there now."""
        self._graph.look()
        self.parameters.look()
        self.joints.look()


class SilenceWatch:
    """Notices joints, or frames, that fall silent.

    By the clock of this machine: stamps may be on another one, or stand still with it.

    Args:
        patience: how long a stamp may stay as it is [s].
        clock: time that never jumps [s].
    """

    def __init__(self, patience: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._patience = patience
        self._clock = clock
        self._heard: dict[str, tuple[int | None, float]] = {}

    def silent(self, stamps: Mapping[str, int | None]) -> tuple[str, ...]:
        """Return the names whose latest stamp has not changed for too long.

        Args:
            stamps: the latest of each name of which something should be heard [ns]; None: nothing
                ever was.
        """
        now = self._clock()
        for name in self._heard.keys() - stamps.keys():
            del self._heard[name]
        for name, stamp in stamps.items():
            if name not in self._heard or self._heard[name][0] != stamp:
                self._heard[name] = stamp, now
        return tuple(name for name in stamps if now - self._heard[name][1] > self._patience)
