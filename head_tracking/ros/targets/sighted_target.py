"""What a node does around a `VisualTracker`: its parameters, its camera, and what comes of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Float32
from std_srvs.srv import Trigger

from head_tracking.parameters import parameter
from head_tracking.ros.kit.images import camera_of, frame_pose
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.target_output import TargetOutput
from head_tracking.ros.kit.worker import Worker
from head_tracking.tracking import Target
from head_tracking.transforms import Transform, TransformBuffer
from head_tracking.vision import (
    Camera,
    CameraError,
    Detector,
    DistanceParameters,
    IdentityParameters,
    Sighting,
    VisualTracker,
)

NEWEST = QoSProfile(depth=2, reliability=ReliabilityPolicy.BEST_EFFORT)
"""An image that nobody had time for is of no use any more."""


@dataclass(frozen=True, slots=True)
class CameraParameters:
    """What `camera_info` is to be read as."""

    rectified: bool = parameter(
        False,
        "The images are rectified (image_rect): the matrix P of camera_info counts, and neither K "
        "nor D nor R.",
    )


class SightedTarget:
    """Makes `target_point` of what a detector finds.

    Listens to `camera_info`; offers `~/reset` and `~/enable`; tells `~/enabled` and `~/confidence`.
    `find_by`, `pose`, `send` and the tracker belong to the worker's thread.

    Args:
        node: whose topics, services and parameters these are.
        detector: finds things.
        buffer: the robot's frames.
        fixed_frame: stands still while the head turns; empty: things are told apart in the frame
            that they come in.
        worker: does what takes its time.

    Attributes:
        output: publishes targets while the node is enabled.
        tracker: keeps to one of the things that are found.
    """

    def __init__(
        self,
        node: Node,
        detector: Detector,
        buffer: TransformBuffer,
        fixed_frame: str,
        worker: Worker[Any],
    ) -> None:
        self._buffer = buffer
        self._fixed_frame = fixed_frame
        self._worker = worker
        self._log = node.get_logger()
        self._camera_parameters = NodeParameters(node, CameraParameters)
        self._distances = NodeParameters(node, DistanceParameters, on_change=self._on_parameters)
        self._identity = NodeParameters(node, IdentityParameters, on_change=self._on_parameters)
        self.find_by(detector)
        self._camera: tuple[Camera, str] | None = None
        self._placed = False
        self.output = TargetOutput(node)
        self._confidence = node.create_publisher(Float32, "~/confidence", 10)
        node.create_subscription(CameraInfo, "camera_info", self._on_info, NEWEST)
        node.create_service(Trigger, "~/reset", self._on_reset)

    @property
    def wanted(self) -> bool:
        """Whether anybody wants to know what is found."""
        return self.output.on or self._confidence.get_subscription_count() > 0

    def find_by(self, detector: Detector) -> None:
        """Looks for other things from now on."""
        self.tracker = VisualTracker(detector, self._distances.value, self._identity.value)

    def camera(self, frame_id: str, otherwise: str) -> Camera | None:
        """The camera whose images have that frame, by the newest camera_info.

        Where there is none, a person is told, after what it leads to. (Some drivers leave the frame
        of camera_info empty.)
        """
        if self._camera is None:
            self.complain(f"{otherwise}: there is no usable camera_info yet")
            return None
        camera, frame = self._camera
        if frame.lstrip("/") not in ("", frame_id.lstrip("/")):
            self.complain(
                f"{otherwise}: camera_info is of a camera in {frame!r}, the image of one in "
                f"{frame_id!r}; remap camera_info to that of the image"
            )
            return None
        return camera

    def pose(self, frame_id: str, stamp: int) -> Transform | None:
        """A frame in the one that stands still, if that is known; at its stamp [ns]."""
        found = frame_pose(self._buffer, self._fixed_frame, frame_id, stamp)
        if (found is not None) != self._placed:
            self._placed = found is not None
            self.tracker.identity.reset()
        return found

    def send(self, stamp: int, frame_id: str, sighting: Sighting | None) -> None:
        """Sends the target that was sighted, unless that is switched off, and how sure it is."""
        if sighting is not None:
            self.output.publish(Target(stamp, frame_id, sighting.point))
        elif self.tracker.without_distance:
            self.complain(
                "something is found, but not how far away: there is no depth for it; without a "
                "depth camera set object_size or distance"
            )
        if self._confidence.get_subscription_count():
            self._confidence.publish(Float32(data=sighting.confidence if sighting else 0.0))

    def complain(self, reason: str) -> None:
        """Tells a person what should be mended."""
        self._log.warning(reason, throttle_duration_sec=2.0)

    def _on_parameters(self, _: Any) -> None:
        self._worker.do(self._take_parameters)

    def _take_parameters(self) -> None:
        self.tracker.distances = self._distances.value
        self.tracker.identity.parameters = self._identity.value

    def _on_info(self, message: CameraInfo) -> None:
        try:
            rectified = self._camera_parameters.value.rectified
            self._camera = camera_of(message, rectified=rectified), message.header.frame_id
        except CameraError as error:
            self._camera = None
            self.complain(str(error))

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._worker.do(self.tracker.reset)
        response.success, response.message = True, "looking for a new target"
        return response
