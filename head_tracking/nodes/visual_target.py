"""visual_target: the point where a camera sees a face, a colour, features or a marker."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, RegionOfInterest
from std_msgs.msg import Float32
from std_srvs.srv import Trigger

from head_tracking.control import ControlLoop
from head_tracking.parameters import parameter
from head_tracking.ros.images import camera_of, depth_of, frame_pose, image_message, picture_of
from head_tracking.ros.parameters import NodeParameters
from head_tracking.ros.spinning import run_node
from head_tracking.ros.switch import Switch
from head_tracking.ros.target_output import TargetOutput
from head_tracking.ros.worker import Worker
from head_tracking.tf import Buffer, listening_buffer
from head_tracking.tf.conversions import stamp_to_ns
from head_tracking.tracking import Target
from head_tracking.transforms import Transform
from head_tracking.vision import (
    DETECTORS,
    Box,
    Camera,
    CameraError,
    DistanceParameters,
    FaceDetector,
    Frame,
    IdentityParameters,
    ImageError,
    Pairing,
    Sighting,
    VisualTracker,
    annotated,
    depth_picture,
    require_opencv,
)

AnyImage: TypeAlias = Image | CompressedImage

# an image that nobody had time for is of no use any more
_NEWEST = QoSProfile(depth=2, reliability=ReliabilityPolicy.BEST_EFFORT)


@dataclass(frozen=True, slots=True)
class VisualTargetParameters:
    """What to follow, and by which images."""

    follow: str = parameter(
        "face",
        "What to follow: `features` is what a rectangle on ~/select holds, `nearest` needs depths "
        "only.",
        choices=tuple(DETECTORS),
    )
    use_depth: bool = parameter(
        True, "Wait for the depth image of each image, if somebody publishes depths.", fixed=True
    )
    image_transport: str = parameter(
        "raw",
        "How pictures come: raw, or compressed on the topic <image>/compressed.",
        choices=("raw", "compressed"),
        fixed=True,
    )
    depth_transport: str = parameter(
        "raw",
        "How depths come: raw, or compressed on the topic <depth>/compressedDepth.",
        choices=("raw", "compressedDepth"),
        fixed=True,
    )
    depth_tolerance: float = parameter(
        0.02,
        "How much the stamps of image and depth image may differ.",
        unit="s",
        minimum=0.0,
        maximum=1.0,
        fixed=True,
    )
    fixed_frame: str = parameter(
        "base_link",
        "A frame that stands still while the head turns: things are told apart by where they are "
        "in it; empty: in the camera's own frame.",
        fixed=True,
    )


class _Shot(NamedTuple):
    """Messages of one moment; the first one's stamp and frame count."""

    stamped: AnyImage
    image: AnyImage | None
    depth: AnyImage | None


class VisualTargetNode(Node):
    """Publishes `target_point` from `image`, `depth` and `camera_info`.

    Looking has a thread of its own, which takes the newest image.
    """

    def __init__(
        self, buffer: Buffer | None = None, loop: ControlLoop | None = None, **options: Any
    ) -> None:
        super().__init__("visual_target", **options)
        require_opencv()
        self._kinds: dict[str, NodeParameters[Any]] = {}
        self._given = NodeParameters(self, VisualTargetParameters, on_change=self._on_follow)
        self._settings = p = self._given.value
        self._distances = NodeParameters(self, DistanceParameters, on_change=self._on_parameters)
        self._identity = NodeParameters(self, IdentityParameters, on_change=self._on_parameters)
        self._tracker = self._make_tracker(p.follow)
        self._buffer = (buffer or listening_buffer(self)).core
        self._pairs: Pairing[AnyImage, AnyImage] = Pairing(round(p.depth_tolerance * 1e9))
        self._camera: Camera | None = None
        self._frame: Frame | None = None
        self._placed = False
        self._switch = Switch(
            self, lambda on: f"the target is {'sent' if on else 'not sent any more'}"
        )
        self._looking: Worker[_Shot] = Worker("visual target", self._look)
        self._output = TargetOutput(self, loop)
        self._confidence = self.create_publisher(Float32, "~/confidence", 10)
        self._region = self.create_publisher(RegionOfInterest, "~/roi", 10)
        self._annotated = self.create_publisher(Image, "~/image", 2)
        self.create_subscription(CameraInfo, "camera_info", self._on_info, _NEWEST)
        self._image: Subscription | None = None
        self._depth: Subscription | None = None
        self._subscribe_for(p.follow)
        self.create_subscription(RegionOfInterest, "~/select", self._on_select, 10)
        self.create_service(Trigger, "~/reset", self._on_reset)

    def destroy_node(self) -> None:
        """Ends the thread that looks too."""
        self._looking.close()
        super().destroy_node()

    def _make_tracker(self, follow: str) -> VisualTracker:
        """What finds and keeps to one kind of thing; its parameters are declared the first time."""
        make, kind = DETECTORS[follow]
        if follow not in self._kinds:
            self._kinds[follow] = NodeParameters(self, kind, on_change=self._on_parameters)
        detector = make(self._kinds[follow].value)
        if isinstance(detector, FaceDetector) and detector.shortcoming:
            self.get_logger().warning(detector.shortcoming)
        return VisualTracker(detector, self._distances.value, self._identity.value)

    def _on_follow(self, changed: VisualTargetParameters) -> None:
        if changed.follow == self._settings.follow:
            return
        self._settings = changed
        self._subscribe_for(changed.follow)
        tracker = self._make_tracker(changed.follow)

        def take() -> None:
            self._tracker = tracker

        self._looking.do(take)
        self.get_logger().info(f"the target is what is found now: {changed.follow}")

    def _subscribe_for(self, follow: str) -> None:
        """Listens to the pictures and depths that are needed to find something."""
        p = self._settings
        wants_image, wants_depth = follow != "nearest", p.use_depth or follow == "nearest"
        if wants_image and self._image is None:
            self._image = self._subscribe("image", p.image_transport, self._on_image)
        elif not wants_image and self._image is not None:
            self.destroy_subscription(self._image)
            self._image = None
        if wants_depth and self._depth is None:
            self._depth = self._subscribe("depth", p.depth_transport, self._on_depth)
        elif not wants_depth and self._depth is not None:
            self.destroy_subscription(self._depth)
            self._depth = None

    def _on_parameters(self, _: Any) -> None:
        self._looking.do(self._take_parameters)

    def _take_parameters(self) -> None:
        self._tracker.detector.parameters = self._kinds[self._settings.follow].value
        self._tracker.distances = self._distances.value
        self._tracker.identity.parameters = self._identity.value

    def _subscribe(
        self, topic: str, transport: str, callback: Callable[[AnyImage], None]
    ) -> Subscription:
        if transport == "raw":
            return self.create_subscription(Image, topic, callback, _NEWEST)
        topic = f"{self.resolve_topic_name(topic)}/{transport}"
        return self.create_subscription(CompressedImage, topic, callback, _NEWEST)

    def _on_info(self, message: CameraInfo) -> None:
        try:
            self._camera = camera_of(message)
        except CameraError as error:
            self._camera = None
            self._complain(str(error))

    def _on_image(self, message: AnyImage) -> None:
        depth = self._depth
        if depth is None or not self.count_publishers(depth.topic_name):
            self._looking.offer(_Shot(message, message, None))
            return
        pair = self._pairs.picture(stamp_to_ns(message.header.stamp), message)
        if pair is not None:
            self._looking.offer(_Shot(pair[0], *pair))
        elif self._pairs.dropped > 2:
            self._complain(
                f"the depth images do not fit the images: {self._pairs.dropped} images without "
                f"one within {self._settings.depth_tolerance:g} s (depth_tolerance)"
            )

    def _on_depth(self, message: AnyImage) -> None:
        if self._settings.follow == "nearest":
            self._looking.offer(_Shot(message, None, message))
            return
        pair = self._pairs.depth(stamp_to_ns(message.header.stamp), message)
        if pair is not None:
            self._looking.offer(_Shot(pair[0], *pair))

    def _look(self, shot: _Shot) -> None:
        """Looks for the target in one image, and publishes it."""
        outputs = (self._confidence, self._region, self._annotated)
        if not self._switch.on and not any(one.get_subscription_count() for one in outputs):
            return
        stamped, image, depth = shot
        camera = self._camera
        if camera is None:
            self._complain("no image is looked at: there is no usable camera_info yet")
            return
        header = stamped.header
        try:
            frame = Frame(
                stamp_to_ns(header.stamp),
                camera,
                None if image is None else picture_of(image),
                None if depth is None else depth_of(depth),
            )
            sighting = self._tracker.step(frame, self._pose(header.frame_id, frame.stamp))
        except ImageError as error:
            self._complain(str(error))
            return
        self._frame = frame
        if sighting is not None:
            target = Target(frame.stamp, header.frame_id, sighting.point)
            if self._switch.on:
                self._output.send(target)
            if self._region.get_subscription_count():
                self._region.publish(_region(sighting.candidate.box, frame))
        elif self._tracker.without_distance:
            self._complain(
                "something is seen, but not how far away: there is no depth for it; without a "
                "depth camera set object_size or distance"
            )
        if self._confidence.get_subscription_count():
            self._confidence.publish(Float32(data=sighting.confidence if sighting else 0.0))
        if self._annotated.get_subscription_count():
            self._show(frame, sighting, stamped)

    def _pose(self, frame_id: str, stamp: int) -> Transform | None:
        found = frame_pose(self._buffer, self._settings.fixed_frame, frame_id, stamp)
        if (found is not None) != self._placed:
            self._placed = found is not None
            self._tracker.identity.reset()
        return found

    def _show(self, frame: Frame, sighting: Sighting | None, stamped: AnyImage) -> None:
        if frame.picture is not None:
            picture = frame.picture.bgr
        else:
            assert frame.depth is not None
            picture = depth_picture(frame.depth, self._tracker.distances.max_distance)
        drawn = annotated(picture, self._tracker.tracks, sighting)
        self._annotated.publish(image_message(stamped.header, "bgr8", drawn))

    def _on_select(self, message: RegionOfInterest) -> None:
        self._looking.do(lambda: self._select(message))

    def _select(self, message: RegionOfInterest) -> None:
        box = Box(message.x_offset, message.y_offset, message.width, message.height)
        if self._frame is None or min(box.clipped(*_size(self._frame))[2:]) <= 0:
            self._complain(
                "the selection is not used: "
                + ("no image has come yet" if self._frame is None else f"{box} is empty")
            )
            return
        self._tracker.select(self._frame, box)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._looking.do(self._tracker.reset)
        response.success, response.message = True, "looking for a new target"
        return response

    def _complain(self, reason: str) -> None:
        self.get_logger().warning(reason, throttle_duration_sec=2.0)


def _size(frame: Frame) -> tuple[int, int]:
    return frame.camera.width, frame.camera.height


def _region(box: Box, frame: Frame) -> RegionOfInterest:
    x, y, width, height = (round(number) for number in box.clipped(*_size(frame)))
    return RegionOfInterest(x_offset=x, y_offset=y, width=width, height=height)


def main() -> int:
    """Runs the node until it is interrupted."""
    return run_node(VisualTargetNode)


if __name__ == "__main__":
    raise SystemExit(main())
