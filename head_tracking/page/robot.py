"""One robot as the page sees and commands it, by topics, services and parameters."""

from __future__ import annotations

import threading
import time
from contextlib import suppress

from rclpy.exceptions import InvalidHandle
from rclpy.node import Node

from head_tracking.exceptions import HeadTrackingError
from head_tracking.gaze import PanTiltHead
from head_tracking.gaze.head_parameters import HeadParameters
from head_tracking.page.head_modes import (
    FOUND_IN_PICTURES,
    POINTER,
    TRACKER,
    VISUAL,
    HeadModes,
    Mode,
)
from head_tracking.page.joint_control import JointPanel
from head_tracking.page.other_topics import OtherTopics
from head_tracking.page.status import Summary, head_status
from head_tracking.page.stop import Attempt, Stop
from head_tracking.recording.recorder import Recorder, RecorderParameters
from head_tracking.recording.recording import Observation, observed
from head_tracking.ros.kit.others import Graph, OtherParameters, OtherServices
from head_tracking.ros.kit.spinning import steady_timer
from head_tracking.ros.kit.threads import NodeThread, PolledNode
from head_tracking.ros.targets.latest_target import LatestTarget
from head_tracking.tf import listening_buffer
from head_tracking.transforms import RobotModel, RobotModelError, TransformException

_DISCOVERY_PERIOD = 1.0  # s
_PATIENCE = 2.0  # s


class Robot:
    """The robot of a node's namespace.

    Frequent topics belong to a node of their own, which `poll` and `observe` poll.

    The node publishes, and subscribes to what comes seldom; another thread must spin it.

    Attributes:
        head: of the model; None: it has none.
        mode: of the head, as of the last `observe`.
    """

    def __init__(
        self,
        node: Node,
        head_parameters: HeadParameters,
        recorder_parameters: RecorderParameters,
    ) -> None:
        self._node = node
        self._head_parameters = head_parameters
        self._model: RobotModel | None = None
        self.head: PanTiltHead | None = None
        self._no_head = ""
        self.mode = Mode.OFF
        self.stop = Stop(node)
        self._attempt: Attempt | None = None
        self._polled = PolledNode(node, "polled")
        self.buffer = listening_buffer(node, self._polled).core
        # its many clients would slow down every wake-up of the other node
        self._requests = NodeThread.beside(node, "requests")
        requests = self._requests.node
        self.graph, self.services = Graph(node), OtherServices(requests)
        self._targets = LatestTarget(self._polled, self.buffer)
        self.topics = OtherTopics(node, self._polled, self.graph)
        self.parameters = OtherParameters(requests, self.graph)
        self.recorder = Recorder(node, recorder_parameters)
        self.modes = HeadModes(node, self)
        self.joints = JointPanel(node, self)
        self._measured: dict[str, tuple[int | None, float]] = {}  # stamp, and since when
        steady_timer(requests, _DISCOVERY_PERIOD, self._discover)
        steady_timer(node, _DISCOVERY_PERIOD, self.topics.end_unused)
        self._requests.start()

    def close(self) -> None:
        """End the page's own nodes; nothing else of the robot changes."""
        self.recorder.stop()
        self._requests.close()
        self.stop.close()
        self._polled.destroy_node()

    def poll(self) -> None:
        """Receive what has come on frequent topics; `observe` does so, too."""
        self._polled.poll()

    def model(self) -> RobotModel | None:
        """Return the robot's model, and update its head when the model has changed."""
        model = self.buffer.model
        if model is not self._model and model is not None:
            self.head, self._no_head = self.head_of(model)
            self._targets.place_in(model.root)
            self._model = model
        return model

    def head_of(self, model: RobotModel) -> tuple[PanTiltHead | None, str]:
        """Return the head of a model; None if it has none, and why."""
        try:
            return self._head_parameters.head(model), ""
        except (RobotModelError, TransformException) as error:
            return None, f"No head is shown: {error}"

    def notices(self) -> tuple[str, ...]:
        """Return what is unusual about the set-up."""
        return tuple(filter(None, (self._no_head, self.modes.conflict())))

    def observe(self) -> Observation:
        """Return the latest of everything; never wait."""
        self.poll()
        model, mode = self._model, self.modes.mode()
        self.mode = mode
        if model is None:
            return Observation(self._now)
        controller = {Mode.OFF: "", Mode.POINT: POINTER}.get(mode, TRACKER)
        status = self.topics.status(controller)
        return observed(
            self._now,
            self.buffer,
            model,
            self._targets.latest(),
            self.topics.error(controller) if controller else None,
            controller,
            status,
        )

    def status(self, live: Observation) -> Summary:
        """Return what the robot does, as of the last `observe`; see `head_status`."""
        is_named = self.mode in FOUND_IN_PICTURES and self.mode is not Mode.VISUAL
        return head_status(
            live,
            self.topics.health(),
            self.joints.servos(),
            self.silent_joints(),
            stopped=self.stop.stopped,
            sought=str(self.mode) if is_named and self.topics.region() is None else "",
            has_camera=self.has_camera,
        )

    @property
    def has_camera(self) -> bool:
        """Whether a camera publishes images; `visual_target` draws on them."""
        return any(not topic.endswith(f"{VISUAL}/image") for topic in self.topics.images())

    def stop_everything(self) -> Attempt:
        """Begin to relax all servos, and then to disable what turns the head; never wait."""
        before, self._attempt = self._attempt, self.stop.begin()
        if self._attempt is not before:
            threading.Thread(target=self._disable_modes, args=[self._attempt], daemon=True).start()
        return self._attempt

    def _disable_modes(self, attempt: Attempt) -> None:
        """Disable what turns the head, unless the bus ignores commands until `resume`."""
        if not (attempt.wait().done or self.stop.stopped):
            with suppress(InvalidHandle, HeadTrackingError):  # the page may have ended meanwhile
                self.modes.set_mode(Mode.OFF)

    @property
    def _now(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)

    def silent_joints(self) -> tuple[str, ...]:
        """Return joints of the head whose measurements should come and do not.

        By this machine's clock: the clock of the stamps may differ or stand still.
        """
        head, now = self.head, time.monotonic()
        joints = () if head is None or self.joints.free else (head.pan_joint, head.tilt_joint)
        measured = {}
        for joint in joints:
            found, last = self.buffer.latest_joint_position(joint), self._measured.get(joint)
            stamp = None if found is None else found[0]
            measured[joint] = (stamp, now) if last is None or last[0] != stamp else last
        self._measured = measured
        return tuple(joint for joint, (_, since) in measured.items() if now - since > _PATIENCE)

    def _discover(self) -> None:
        self.graph.look()
        self.parameters.look()
        self.joints.discover()
