"""visual_target: publish the position of a face, colour, features or marker in images."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from geometry_msgs.msg import Point, PointStamped, Pose, PoseArray
from rclpy.subscription import Subscription
from sensor_msgs.msg import CompressedImage, Image, RegionOfInterest

from head_tracking.detectors import DETECTORS
from head_tracking.exceptions import HeadTrackingError
from head_tracking.parameters import parameter
from head_tracking.ros.kit.images import depth_of, image_message, picture_of
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.spinning import steady_timer
from head_tracking.ros.kit.target_point import target_from_message
from head_tracking.ros.kit.topics import OVERRIDABLE
from head_tracking.ros.targets.sighted_target import LATEST_ONLY, SightedTargetNode
from head_tracking.tf import Buffer
from head_tracking.tf.conversions import stamp_to_ns
from head_tracking.tracking import Target
from head_tracking.vision import (
    Box,
    Detector,
    FaceDetector,
    Frame,
    Pairing,
    Sighting,
    annotated,
    require_opencv,
)
from head_tracking.vision.identity import Track

AnyImage: TypeAlias = Image | CompressedImage

_SUBSCRIPTION_PERIOD = 0.2  # s between checks for subscribers


@dataclass(frozen=True, slots=True)
class VisualTargetParameters:
    """Kind of target, and images."""

    follow: str = parameter(
        "face",
        "Kind of target; `features` is the content of a box on ~/select.",
        choices=tuple(DETECTORS),
    )
    use_depth: bool = parameter(
        True, "Wait for the depth image of each image, if depths are published.", fixed=True
    )
    image_transport: str = parameter(
        "raw",
        "Transport of images: raw, or compressed on the topic <image>/compressed.",
        choices=("raw", "compressed"),
        fixed=True,
    )
    depth_transport: str = parameter(
        "raw",
        "Transport of depths: raw, or compressed on the topic <depth>/compressedDepth.",
        choices=("raw", "compressedDepth"),
        fixed=True,
    )
    depth_tolerance: float = parameter(
        0.02,
        "Maximum difference of the stamps of image and depth image.",
        unit="s",
        minimum=0.0,
        maximum=1.0,
        fixed=True,
    )


class VisualTargetNode(SightedTargetNode):
    """Publishes `target_point` from `image`, `depth` and `camera_info`.

    A thread processes the latest image. While the node is disabled and its outputs have no
    subscribers, it does not subscribe to images.
    """

    def __init__(self, buffer: Buffer | None = None, **options: Any) -> None:
        require_opencv()
        super().__init__("visual_target", buffer, **options)
        self._settings = p = NodeParameters(
            self, VisualTargetParameters, on_change=self._on_follow
        ).value
        self._kinds = {
            kind: NodeParameters(self, kind, on_change=self._on_parameters)
            for kind in dict.fromkeys(spec.load().Parameters for spec in DETECTORS.values())
        }
        self.set_detector(self._detector(p.follow))
        self._pairs: Pairing[AnyImage, AnyImage] = Pairing(round(p.depth_tolerance * 1e9))
        self._frame: Frame | None = None
        self._region = self.create_publisher(RegionOfInterest, "~/roi", 10)
        self._others = self.create_publisher(PoseArray, "~/others", 10)
        self._annotated = self.create_publisher(
            Image, "~/image", 2, qos_overriding_options=OVERRIDABLE
        )
        self._inputs: dict[str, Subscription] = {}
        self._subscribe_as_needed()
        steady_timer(self, _SUBSCRIPTION_PERIOD, self._subscribe_as_needed)
        self.create_subscription(RegionOfInterest, "~/select", self._on_select, 10)
        self.create_subscription(PointStamped, "~/select_point", self._on_select_point, 10)

    def _detector(self, follow: str) -> Detector:
        """Create a detector; this may take long."""
        spec = DETECTORS[follow]
        detector = spec.make(self._kinds[spec.load().Parameters].value)
        if isinstance(detector, FaceDetector) and detector.shortcoming:
            self.get_logger().warning(detector.shortcoming)
        return detector

    def _on_follow(self, changed: VisualTargetParameters) -> None:
        if changed.follow == self._settings.follow:
            return
        self._settings = changed
        self.worker.do(lambda: self._change_detector(changed.follow))

    def _change_detector(self, follow: str) -> None:
        """Change the detector, unless `follow` has changed again."""
        if follow != self._settings.follow:
            return
        try:
            self.set_detector(self._detector(follow))
        except HeadTrackingError as error:
            self.set_detector(None)
            self.get_logger().error(f"no detection: the detector {follow} failed: {error}")
        else:
            self.get_logger().info(f"detecting {follow}")

    def _subscribe_as_needed(self) -> None:
        """Subscribe to the images while something is published for somebody."""
        p = self._settings
        outputs = (self._region, self._others, self._annotated)
        wanted = self.output.on or any(one.get_subscription_count() for one in outputs)
        if not wanted:
            while self._inputs:
                self.destroy_subscription(self._inputs.popitem()[1])
        elif not self._inputs:
            self._inputs["image"] = self._subscribe("image", p.image_transport, self._on_image)
            if p.use_depth:
                self._inputs["depth"] = self._subscribe("depth", p.depth_transport, self._on_depth)

    def _on_parameters(self, parameters: Any) -> None:
        def apply() -> None:
            detector = self.tracker.detector
            if detector is not None and isinstance(parameters, detector.Parameters):
                detector.parameters = parameters

        self.worker.do(apply)

    def _subscribe(
        self, topic: str, transport: str, callback: Callable[[AnyImage], None]
    ) -> Subscription:
        if transport == "raw":
            return self.create_subscription(Image, topic, callback, LATEST_ONLY)
        topic = f"{self.resolve_topic_name(topic)}/{transport}"
        return self.create_subscription(CompressedImage, topic, callback, LATEST_ONLY)

    def _on_image(self, message: AnyImage) -> None:
        depth = self._inputs.get("depth")
        if depth is None or not self.count_publishers(depth.topic_name):
            self._offer((message, None))
            return
        pair = self._pairs.picture(stamp_to_ns(message.header.stamp), message)
        if pair is not None:
            self._offer(pair)
        elif self._pairs.dropped > 2:
            self.warn(
                f"{self._pairs.dropped} images without a depth image within "
                f"{self._settings.depth_tolerance:g} s (depth_tolerance)"
            )

    def _on_depth(self, message: AnyImage) -> None:
        pair = self._pairs.depth(stamp_to_ns(message.header.stamp), message)
        if pair is not None:
            self._offer(pair)

    def _offer(self, shot: tuple[AnyImage, AnyImage | None]) -> None:
        self.stamp(shot[0].header)
        self.worker.offer(shot)

    def process(self, shot: tuple[AnyImage, AnyImage | None]) -> None:
        """See `SightedTargetNode`; an image, and its depths if there are any."""
        image, depth = shot
        header = image.header
        camera = self.camera_of(header.frame_id)
        picture = picture_of(image)
        depths = None if depth is None else depth_of(depth)
        self._frame = frame = Frame(stamp_to_ns(header.stamp), camera, picture, depths)
        sighting = self.tracker.step(frame, self.pose(header.frame_id, frame.stamp))
        self.send(frame.stamp, header.frame_id, sighting)
        if sighting is not None and self._region.get_subscription_count():
            self._region.publish(_region(sighting.candidate.box, frame))
        if self._others.get_subscription_count():
            others = _others(self.tracker.tracks, sighting)
            self._others.publish(PoseArray(header=header, poses=others))
        if self._annotated.get_subscription_count():
            drawn = annotated(picture.bgr, self.tracker.tracks, sighting)
            self._annotated.publish(image_message(header, "bgr8", drawn))

    def _on_select(self, message: RegionOfInterest) -> None:
        self.worker.do(lambda: self._select(message))

    def _select(self, message: RegionOfInterest) -> None:
        if not DETECTORS[self._settings.follow].needs_selection:
            self.warn("the selection is ignored: ~/select is for follow:=features")
            return
        box = Box(message.x_offset, message.y_offset, message.width, message.height)
        if self._frame is None or min(box.clipped(*_size(self._frame))[2:]) <= 0:
            self.warn(
                "the selection is ignored: "
                + ("no image received yet" if self._frame is None else f"{box} is empty")
            )
            return
        self.tracker.select(self._frame, box)

    def _on_select_point(self, message: PointStamped) -> None:
        target = target_from_message(message)
        self.worker.do(lambda: self._select_point(target))

    def _select_point(self, target: Target) -> None:
        pose = self.pose(target.frame_id, target.stamp)
        point = target.point if pose is None else pose @ target.point
        is_comparable = (pose is not None) == self.tracker.has_pose  # with the tracks
        if not (is_comparable and self.tracker.select_point(point)):
            self.warn(f"the selection is ignored: nothing is seen at {target.point}")


def _others(tracks: Sequence[Track], followed: Sighting | None) -> list[Pose]:
    """Return the positions of visible tracks in the optical frame [m], but the followed one."""
    number = None if followed is None else followed.number
    points = [t.located.point for t in tracks if t.believed and t.located and t.number != number]
    return [Pose(position=Point(x=x, y=y, z=z)) for x, y, z in points]


def _size(frame: Frame) -> tuple[int, int]:
    return frame.camera.width, frame.camera.height


def _region(box: Box, frame: Frame) -> RegionOfInterest:
    x, y, width, height = (round(number) for number in box.clipped(*_size(frame)))
    return RegionOfInterest(x_offset=x, y_offset=y, width=width, height=height)
