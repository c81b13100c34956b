"""The base class of the nodes that publish a target from detections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from head_tracking.parameters import parameter
from head_tracking.ros.kit.images import camera_of, frame_pose
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.spinning import ClosingNode
from head_tracking.ros.kit.target_point import TargetOutput
from head_tracking.ros.kit.threads import Worker, answering
from head_tracking.tf import Buffer, listening_buffer
from head_tracking.tf.conversions import stamp_to_ns
from head_tracking.tracking import Target
from head_tracking.transforms import Transform
from head_tracking.vision import (
    Camera,
    CameraError,
    Detector,
    DistanceParameters,
    IdentityParameters,
    ImageError,
    Sighting,
    VisualTracker,
)

LATEST_ONLY = QoSProfile(depth=2, reliability=ReliabilityPolicy.BEST_EFFORT)
"""QoS of images: late ones are dropped."""


@dataclass(frozen=True, slots=True)
class CameraParameters:
    """Interpretation of `camera_info`, and where objects are tracked."""

    rectified: bool = parameter(
        False,
        "The images are rectified (image_rect): use the matrix P of camera_info instead of K, D "
        "and R.",
    )
    fixed_frame: str = parameter(
        "base_link",
        "A frame that does not move with the head, in which objects are tracked; empty: that of "
        "the images or detections.",
        fixed=True,
    )


class SightedTargetNode(ClosingNode):
    """Publishes `target_point` from detections; a subclass may call `set_detector`.

    Subscribes to `camera_info`; offers `~/reset` and `~/enable`; publishes `~/enabled`. Call
    `set_detector`, `send` and the tracker in the worker's thread only, once the node is spun.

    Args:
        name: of the node.
        buffer: the frames of the robot; None: subscribe to them.
        options: of the node.

    Attributes:
        worker: thread for detection and tracking, which calls `process`.
        output: publishes targets while the node is enabled.
        tracker: tracks one target.
    """

    def __init__(self, name: str, buffer: Buffer | None, **options: Any) -> None:
        super().__init__(name, **options)
        self.frames = (buffer or listening_buffer(self)).core
        self._camera_parameters = NodeParameters(self, CameraParameters)
        self._distances = NodeParameters(self, DistanceParameters, on_change=self._on_distances)
        self._identity = NodeParameters(self, IdentityParameters, on_change=self._on_distances)
        self._camera: tuple[Camera, str] | None = None
        self.worker: Worker[Any] = Worker(name, self._process)
        self.closing.callback(self.worker.close)
        self.set_detector(None)
        self.output = TargetOutput(self)
        self.create_subscription(CameraInfo, "camera_info", self._on_info, LATEST_ONLY)
        self.create_service(Trigger, "~/reset", answering(self._on_reset))

    def process(self, item: Any) -> None:
        """Detect the target in an item that was offered to the worker, and publish it.

        Raises:
            ImageError: it cannot be used; this is logged.
        """
        raise NotImplementedError

    def _process(self, item: Any) -> None:
        try:
            self.process(item)
        except ImageError as error:
            self.warn(str(error))

    def stamp(self, header: Header) -> int:
        """Return the stamp of what arrives now [ns]; if it has none, it gets the present time."""
        if not stamp_to_ns(header.stamp):
            header.stamp = self.get_clock().now().to_msg()
        return stamp_to_ns(header.stamp)

    def set_detector(self, detector: Detector | None) -> None:
        """Start a new tracker with a detector; None: it detects nothing."""
        self.tracker = VisualTracker(detector, self._distances.value, self._identity.value)

    def camera_of(self, frame_id: str) -> Camera:
        """Return the camera of an optical frame; raise ImageError if it is not known."""
        if self._camera is None:
            raise ImageError("the image is ignored: no valid camera_info received")
        camera, frame = self._camera
        # some drivers leave the frame of camera_info empty
        if frame.lstrip("/") not in ("", frame_id.lstrip("/")):
            raise ImageError(
                f"the image is ignored: camera_info has the frame {frame!r} and the image "
                f"{frame_id!r}; remap camera_info to the topic of that camera"
            )
        return camera

    def pose(self, frame_id: str, stamp: int) -> Transform | None:
        """Return the pose of a frame in the fixed frame at a stamp [ns]; None: unknown."""
        fixed_frame = self._camera_parameters.value.fixed_frame
        return frame_pose(self.frames, fixed_frame, frame_id, stamp)

    def send(self, stamp: int, frame_id: str, sighting: Sighting | None) -> None:
        """Publish a target, if enabled."""
        if sighting is not None:
            self.output.publish(Target(stamp, frame_id, sighting.point))
        elif self.tracker.late:
            self.warn(
                f"no target: the stamp is {self.tracker.late:.2f} s older than the one before; "
                "does more than one program publish on this topic?"
            )
        elif self.tracker.without_distance:
            self.warn(
                "the distance of a detection is unknown: it has no depth from min_distance to "
                "max_distance; without a depth camera, set object_size or distance"
            )
        elif (doubted := self.tracker.doubted) is not None:
            self.warn(
                f"no target: the confidence of what is seen is {doubted:.2f}; min_confidence is "
                f"{self.tracker.identity.min_confidence:g}"
            )

    def warn(self, reason: str) -> None:
        """Log a warning, at most every 2 s."""
        self.get_logger().warning(reason, throttle_duration_sec=2.0)

    def _on_distances(self, _: Any) -> None:
        self.worker.do(self._apply_distances)

    def _apply_distances(self) -> None:
        self.tracker.distances = self._distances.value
        self.tracker.identity = self._identity.value

    def _on_info(self, message: CameraInfo) -> None:
        try:
            rectified = self._camera_parameters.value.rectified
            self._camera = camera_of(message, rectified=rectified), message.header.frame_id
        except CameraError as error:
            self._camera = None
            self.warn(str(error))

    def _on_reset(self, _: Trigger.Request) -> str:
        self.worker.do(self.tracker.reset)
        return "searching for a new target"
