"""detection_target: one of the things that another program has found, and keeps to it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

from rclpy.subscription import Subscription
from sensor_msgs.msg import Image
from std_msgs.msg import String

from head_tracking.parameters import parameter
from head_tracking.ros.kit.closing_node import ClosingNode
from head_tracking.ros.kit.images import depth_of
from head_tracking.ros.kit.message_types import message_class
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.qos import MEASUREMENT
from head_tracking.ros.kit.worker import Worker
from head_tracking.ros.targets.detections import candidates, places, region_candidate
from head_tracking.ros.targets.sighted_target import NEWEST, SightedTarget
from head_tracking.tf import Buffer, listening_buffer
from head_tracking.tf.conversions import stamp_to_ns
from head_tracking.transforms import TransformException, Vector3
from head_tracking.vision import (
    Camera,
    Candidate,
    DepthImage,
    Frame,
    GivenDetector,
    ImageError,
    require_opencv,
)

_MESSAGES = {
    "detections_2d": "vision_msgs/msg/Detection2DArray",
    "detections_3d": "vision_msgs/msg/Detection3DArray",
}
"""What comes on `detections`; other sources are ROS4HRI's."""

_DEPTHS_KEPT = 30
"""Who detects takes its time; the depth image of the same moment has to wait for it."""


@dataclass(frozen=True, slots=True)
class DetectionTargetParameters:
    """Who finds things, and how they are placed."""

    source: str = parameter(
        "detections_2d",
        "vision_msgs arrays on `detections`: detections_2d in an image, detections_3d in space; or "
        "faces or bodies of ROS4HRI, on /humans.",
        choices=("detections_2d", "detections_3d", "faces", "bodies"),
        fixed=True,
    )
    class_id: str = parameter("", "Of a vision_msgs array: the class that counts; empty: all.")
    humans: str = parameter(
        "/humans", "Where ROS4HRI's topics are: <humans>/faces/tracked, ...", fixed=True
    )
    depth_tolerance: float = parameter(
        0.02,
        "How much the stamps of a detection and a depth image may differ.",
        unit="s",
        minimum=0.0,
        maximum=1.0,
    )
    fixed_frame: str = parameter(
        "base_link",
        "A frame that stands still while the head turns: things are told apart by where they are "
        "in it; empty: in the frame that they come in.",
        fixed=True,
    )


class DetectionTargetNode(ClosingNode):
    """Publishes `target_point` from what other programs detect.

    Raises:
        MessagesMissingError: the messages of the source are not installed.
    """

    def __init__(self, buffer: Buffer | None = None, **options: Any) -> None:
        super().__init__("detection_target", **options)
        self._parameters_read = NodeParameters(self, DetectionTargetParameters)
        p = self._parameters_read.value
        kind = message_class(_MESSAGES.get(p.source, "hri_msgs/msg/IdsList"))
        if p.source != "detections_3d":
            require_opencv()
        self._detector = GivenDetector()
        self._buffer = (buffer or listening_buffer(self)).core
        self._working: Worker[Any] = Worker("detection target", self._take)
        self.closing.callback(self._working.close)
        self._target = SightedTarget(
            self,
            self._detector,
            self._buffer,
            p.fixed_frame,
            self._working,
        )
        self._depths: deque[tuple[int, Image]] = deque(maxlen=_DEPTHS_KEPT)
        self._regions: dict[str, Subscription] = {}
        self._newest: dict[str, Any] = {}
        self._name = self.create_publisher(String, "~/id", 10)
        if p.source in _MESSAGES:
            self.create_subscription(kind, "detections", self._working.offer, NEWEST)
        else:
            self._region_class = message_class("hri_msgs/msg/NormalizedRegionOfInterest2D")
            tracked = f"{p.humans}/{p.source}/tracked"
            self.create_subscription(kind, tracked, self._on_ids, MEASUREMENT)
        if p.source != "detections_3d":
            self.create_subscription(Image, "depth", self._on_depth, NEWEST)

    def _on_depth(self, message: Image) -> None:
        self._depths.append((stamp_to_ns(message.header.stamp), message))

    # ROS4HRI: a topic for each face or body

    def _on_ids(self, message: Any) -> None:
        p = self._parameters_read.value
        for gone in self._regions.keys() - set(message.ids):
            self.destroy_subscription(self._regions.pop(gone))
            self._newest.pop(gone, None)
        for new in set(message.ids) - self._regions.keys():
            self._regions[new] = self.create_subscription(
                self._region_class,
                f"{p.humans}/{p.source}/{new}/roi",
                lambda region, name=new: self._on_region(name, region),
                NEWEST,
            )
        if not message.ids:
            self._working.offer((stamp_to_ns(message.header.stamp), message.header.frame_id, {}))

    def _on_region(self, name: str, region: Any) -> None:
        """Takes the regions of one image together: when all are there, or the next one's come."""
        stamp = stamp_to_ns(region.header.stamp)
        late = [other for other in self._newest.values() if stamp_to_ns(other.header.stamp) < stamp]
        if late:
            self._offer_regions()
        self._newest[name] = region
        if len(self._newest) == len(self._regions):
            self._offer_regions()

    def _offer_regions(self) -> None:
        regions, self._newest = self._newest, {}
        newest = max(regions.values(), key=lambda region: stamp_to_ns(region.header.stamp))
        header = newest.header
        self._working.offer((stamp_to_ns(header.stamp), header.frame_id, regions))

    # in the worker's thread

    def _take(self, found: Any) -> None:
        p = self._parameters_read.value
        if isinstance(found, tuple):
            stamp, frame_id, regions = found
        else:
            stamp, frame_id = stamp_to_ns(found.header.stamp), found.header.frame_id
        if p.source == "detections_3d":
            pose = self._target.pose(frame_id, stamp)
            sighting = self._target.tracker.place(stamp, places(found.detections, p.class_id), pose)
        else:
            camera = self._target.camera(frame_id, "no detection is placed")
            if camera is None:
                return
            if isinstance(found, tuple):
                given = self._people(regions, camera, frame_id, stamp)
            else:
                given = candidates(found.detections, p.class_id)
            self._detector.candidates = given
            try:
                frame = Frame(stamp, camera, None, self._depth(stamp))
                sighting = self._target.tracker.step(frame, self._target.pose(frame_id, stamp))
            except ImageError as error:
                self._target.complain(str(error))
                return
        self._target.send(stamp, frame_id, sighting)
        if sighting is not None and self._name.get_subscription_count():
            name = sighting.candidate.label or str(sighting.number)
            self._name.publish(String(data=name))

    def _people(
        self, regions: dict[str, Any], camera: Camera, frame_id: str, stamp: int
    ) -> list[Candidate]:
        kind = {"faces": "face", "bodies": "body"}[self._parameters_read.value.source]
        found = (
            region_candidate(
                name,
                region,
                camera,
                self._placed_frame(f"{kind}_{name}", frame_id, stamp),
            )
            for name, region in regions.items()
        )
        return [candidate for candidate in found if candidate is not None]

    def _placed_frame(self, person: str, camera: str, stamp: int) -> Vector3 | None:
        """Where the frame of a face or a body is, if somebody publishes it."""
        try:
            return self._buffer.transform_point((0.0, 0.0, 0.0), camera, person, stamp)
        except TransformException:
            return None

    def _depth(self, stamp: int) -> DepthImage | None:
        """The depth image of the same moment, if there is one."""
        near = min(list(self._depths), key=lambda item: abs(item[0] - stamp), default=None)
        tolerance = self._parameters_read.value.depth_tolerance
        if near is None or abs(near[0] - stamp) * 1e-9 > tolerance:
            return None
        return depth_of(near[1])
