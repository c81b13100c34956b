"""detection_target: follow one of the detections of another program."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rclpy.exceptions import NameValidationException
from rclpy.subscription import Subscription
from sensor_msgs.msg import Image
from std_msgs.msg import String

from head_tracking.parameters import parameter
from head_tracking.ros.kit.images import depth_of
from head_tracking.ros.kit.message_types import message_class
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.topics import MEASUREMENT
from head_tracking.ros.targets.detections import candidates, located, region_candidate
from head_tracking.ros.targets.sighted_target import LATEST_ONLY, SightedTargetNode
from head_tracking.tf import Buffer
from head_tracking.tf.conversions import stamp_to_ns
from head_tracking.transforms import TransformException, Vector3
from head_tracking.vision import (
    Camera,
    Candidate,
    DepthImage,
    Frame,
    require_opencv,
)

_MESSAGES = {
    "detections_2d": "vision_msgs/msg/Detection2DArray",
    "detections_3d": "vision_msgs/msg/Detection3DArray",
}
"""Message types on `detections`; the other sources are those of ROS4HRI."""

_DEPTHS_KEPT = 30  # depth images: detections arrive later
_CLASSES_SHOWN = 5


@dataclass(frozen=True, slots=True)
class DetectionTargetParameters:
    """Source of the detections, and depths."""

    source: str = parameter(
        "detections_2d",
        "vision_msgs arrays on `detections` (detections_2d in an image, detections_3d in space) "
        "or faces or bodies of ROS4HRI on /humans.",
        choices=("detections_2d", "detections_3d", "faces", "bodies"),
        fixed=True,
    )
    class_id: str = parameter("", "Class of vision_msgs detections to follow; empty: all.")
    humans: str = parameter(
        "/humans", "Namespace of ROS4HRI: <humans>/faces/tracked, ...", fixed=True, ros_name=True
    )
    depth_tolerance: float = parameter(
        0.02,
        "Maximum difference of the stamps of detection and depth image.",
        unit="s",
        minimum=0.0,
        maximum=1.0,
    )


class DetectionTargetNode(SightedTargetNode):
    """Publishes `target_point` from detections of other programs.

    Raises:
        MessagesMissingError: the message package of the source is not installed.
    """

    def __init__(self, buffer: Buffer | None = None, **options: Any) -> None:
        super().__init__("detection_target", buffer, **options)
        self._parameters_read = NodeParameters(self, DetectionTargetParameters)
        p = self._parameters_read.value
        kind = message_class(_MESSAGES.get(p.source, "hri_msgs/msg/IdsList"))
        if p.source != "detections_3d":
            require_opencv()
        self._depths: deque[tuple[int, Image]] = deque(maxlen=_DEPTHS_KEPT)
        self._regions: dict[str, Subscription] = {}
        self._latest: dict[str, Any] = {}
        self._seen_class = ""
        self._name = self.create_publisher(String, "~/id", 10)
        if p.source in _MESSAGES:
            self.create_subscription(kind, "detections", self._on_detections, LATEST_ONLY)
        else:
            self._region_class = message_class("hri_msgs/msg/NormalizedRegionOfInterest2D")
            tracked = f"{p.humans}/{p.source}/tracked"
            self.create_subscription(kind, tracked, self._on_ids, MEASUREMENT)
        if p.source != "detections_3d":
            self.create_subscription(Image, "depth", self._on_depth, LATEST_ONLY)

    def _on_detections(self, message: Any) -> None:
        self.stamp(message.header)
        self.worker.offer(message)

    def _on_depth(self, message: Image) -> None:
        self._depths.append((self.stamp(message.header), message))

    def _on_ids(self, message: Any) -> None:
        """Subscribe to the region of each face or body of ROS4HRI."""
        p = self._parameters_read.value
        for gone in self._regions.keys() - set(message.ids):
            self.destroy_subscription(self._regions.pop(gone))
            self._latest.pop(gone, None)
        for new in set(message.ids) - self._regions.keys():
            try:
                self._regions[new] = self.create_subscription(
                    self._region_class,
                    f"{p.humans}/{p.source}/{new}/roi",
                    lambda region, name=new: self._on_region(name, region),
                    LATEST_ONLY,
                )
            except (NameValidationException, ValueError):
                self.warn(f"{new!r} is ignored: an id must be a valid part of a topic's name")
        if not message.ids:
            self.worker.offer((self.stamp(message.header), message.header.frame_id, {}))

    def _on_region(self, name: str, region: Any) -> None:
        """Collect the regions of one image until they are complete or the next image comes."""
        stamp = stamp_to_ns(region.header.stamp)
        late = [other for other in self._latest.values() if stamp_to_ns(other.header.stamp) < stamp]
        if late:
            self._offer_regions()
        self._latest[name] = region
        if len(self._latest) == len(self._regions):
            self._offer_regions()

    def _offer_regions(self) -> None:
        regions, self._latest = self._latest, {}
        latest = max(regions.values(), key=lambda region: stamp_to_ns(region.header.stamp))
        header = latest.header
        self.worker.offer((self.stamp(header), header.frame_id, regions))

    def process(self, found: Any) -> None:
        """See `SightedTargetNode`."""
        p = self._parameters_read.value
        if isinstance(found, tuple):
            stamp, frame_id, regions = found
        else:
            stamp, frame_id = stamp_to_ns(found.header.stamp), found.header.frame_id
            self._check_classes(found.detections, p.class_id)
        if p.source == "detections_3d":
            things = located(found.detections, p.class_id)
        else:
            camera = self.camera_of(frame_id)
            if isinstance(found, tuple):
                given = self._people(regions, camera, frame_id, stamp)
            else:
                given = candidates(found.detections, p.class_id)
            size = camera.width, camera.height
            inside = [one for one in given if min(one.box.clipped(*size)[2:]) > 0]
            if len(inside) < len(given):
                self.warn(
                    f"a detection is ignored: it lies outside the image of {size[0]}x{size[1]} "
                    "pixels of camera_info; the camera_info must be that of the detector's images"
                )
            things = self.tracker.locate(Frame(stamp, camera, None, self._depth(stamp)), inside)
        sighting = self.tracker.update(stamp, things, self.pose(frame_id, stamp))
        self.send(stamp, frame_id, sighting)
        if sighting is not None and self._name.get_subscription_count():
            name = sighting.candidate.label or str(sighting.number)
            self._name.publish(String(data=name))

    def _check_classes(self, detections: Sequence[Any], wanted: str) -> None:
        """Warn that the class to follow was not among detections yet."""
        kinds = {result.hypothesis.class_id for each in detections for result in each.results}
        if wanted in kinds:
            self._seen_class = wanted
        elif wanted and kinds and self._seen_class != wanted:
            others = ", ".join(sorted(kinds)[:_CLASSES_SHOWN])
            self.warn(f"no target: class_id is {wanted!r}; the detections have {others}")

    def _people(
        self, regions: dict[str, Any], camera: Camera, frame_id: str, stamp: int
    ) -> list[Candidate]:
        kind = {"faces": "face", "bodies": "body"}[self._parameters_read.value.source]
        found = (
            region_candidate(
                name,
                region,
                camera,
                self._position(f"{kind}_{name}", frame_id, stamp),
            )
            for name, region in regions.items()
        )
        return [candidate for candidate in found if candidate is not None]

    def _position(self, person: str, camera: str, stamp: int) -> Vector3 | None:
        """Return the origin of the frame of a face or body [m], if it is published."""
        try:
            return self.frames.transform_point((0.0, 0.0, 0.0), camera, person, stamp)
        except TransformException:
            return None

    def _depth(self, stamp: int) -> DepthImage | None:
        """Return the depth image with the same stamp, if there is one."""
        near = min(list(self._depths), key=lambda item: abs(item[0] - stamp), default=None)
        tolerance = self._parameters_read.value.depth_tolerance
        if near is None or abs(near[0] - stamp) * 1e-9 > tolerance:
            return None
        return depth_of(near[1])
