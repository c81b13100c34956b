"""visual_target: the point where a camera sees a face, a colour, features or a marker."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

from rclpy.subscription import Subscription
from sensor_msgs.msg import CompressedImage, Image, RegionOfInterest

from head_tracking.exceptions import HeadTrackingError
from head_tracking.parameters import parameter
from head_tracking.ros.kit.closing_node import ClosingNode
from head_tracking.ros.kit.images import depth_of, image_message, picture_of
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.spinning import steady_timer
from head_tracking.ros.kit.worker import Worker
from head_tracking.ros.targets.sighted_target import NEWEST, SightedTarget
from head_tracking.tf import Buffer, listening_buffer
from head_tracking.tf.conversions import stamp_to_ns
from head_tracking.vision import (
    DETECTORS,
    Box,
    Detector,
    FaceDetector,
    Frame,
    GivenDetector,
    ImageError,
    Pairing,
    Sighting,
    annotated,
    depth_picture,
    require_opencv,
)

AnyImage: TypeAlias = Image | CompressedImage

_ASKED_EVERY = 0.2  # s: whether somebody wants to know what is found


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


class VisualTargetNode(ClosingNode):
    """Publishes `target_point` from `image`, `depth` and `camera_info`.

    Looking has a thread of its own, which takes the newest image. While the node is switched off
    and nobody listens to what it finds, it subscribes to no images: nobody has to make them.
    """

    def __init__(self, buffer: Buffer | None = None, **options: Any) -> None:
        super().__init__("visual_target", **options)
        require_opencv()
        self._kinds: dict[str, NodeParameters[Any]] = {}
        self._settings = p = NodeParameters(
            self, VisualTargetParameters, on_change=self._on_follow
        ).value
        self._declare(p.follow)
        self._found = p.follow  # for the thread that looks
        self._looking: Worker[_Shot] = Worker("visual target", self._look)
        self.closing.callback(self._looking.close)
        self._target = SightedTarget(
            self,
            self._detector(p.follow),
            (buffer or listening_buffer(self)).core,
            p.fixed_frame,
            self._looking,
        )
        self._pairs: Pairing[AnyImage, AnyImage] = Pairing(round(p.depth_tolerance * 1e9))
        self._frame: Frame | None = None
        self._region = self.create_publisher(RegionOfInterest, "~/roi", 10)
        self._annotated = self.create_publisher(Image, "~/image", 2)
        self._image: Subscription | None = None
        self._depth: Subscription | None = None
        self._subscribe_as_needed()
        steady_timer(self, _ASKED_EVERY, self._subscribe_as_needed)
        self.create_subscription(RegionOfInterest, "~/select", self._on_select, 10)

    @property
    def enabled(self) -> bool:
        """Whether targets are published."""
        return self._target.output.on

    @enabled.setter
    def enabled(self, enabled: bool) -> None:
        if enabled != self.enabled:
            self._target.output.set(enabled)

    def _detector(self, follow: str) -> Detector:
        """What finds one kind of thing; takes its time."""
        detector = DETECTORS[follow][0](self._kinds[follow].value)
        if isinstance(detector, FaceDetector) and detector.shortcoming:
            self.get_logger().warning(detector.shortcoming)
        return detector

    def _on_follow(self, changed: VisualTargetParameters) -> None:
        if changed.follow == self._settings.follow:
            return
        self._declare(changed.follow)
        self._settings = changed
        self._looking.do(lambda: self._find_by(changed.follow))
        self._subscribe_as_needed()

    def _declare(self, follow: str) -> None:
        """Declares the parameters of one kind of thing, the first time."""
        if follow not in self._kinds:
            kind = DETECTORS[follow][1]
            self._kinds[follow] = NodeParameters(self, kind, on_change=self._on_parameters)

    def _find_by(self, follow: str) -> None:
        """Looks for another kind of thing, if nobody has changed their mind meanwhile."""
        if follow != self._settings.follow:
            return
        self._found = follow
        try:
            self._target.find_by(self._detector(follow))
        except HeadTrackingError as error:
            self._target.find_by(GivenDetector())
            self.get_logger().error(f"nothing is found, {follow} cannot be looked for: {error}")
        else:
            self.get_logger().info(f"the target is what is found now: {follow}")

    def _subscribe_as_needed(self) -> None:
        """Listens to the pictures and depths that are needed to find something."""
        p = self._settings
        outputs = (self._region, self._annotated)
        wanted = self._target.wanted or any(one.get_subscription_count() for one in outputs)
        wants_image = wanted and p.follow != "nearest"
        wants_depth = wanted and (p.use_depth or p.follow == "nearest")
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
        self._target.tracker.detector.parameters = self._kinds[self._found].value

    def _subscribe(
        self, topic: str, transport: str, callback: Callable[[AnyImage], None]
    ) -> Subscription:
        if transport == "raw":
            return self.create_subscription(Image, topic, callback, NEWEST)
        topic = f"{self.resolve_topic_name(topic)}/{transport}"
        return self.create_subscription(CompressedImage, topic, callback, NEWEST)

    def _on_image(self, message: AnyImage) -> None:
        depth = self._depth
        if depth is None or not self.count_publishers(depth.topic_name):
            self._looking.offer(_Shot(message, message, None))
            return
        pair = self._pairs.picture(stamp_to_ns(message.header.stamp), message)
        if pair is not None:
            self._looking.offer(_Shot(pair[0], *pair))
        elif self._pairs.dropped > 2:
            self._target.complain(
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
        stamped, image, depth = shot
        header = stamped.header
        camera = self._target.camera(header.frame_id, "no image is looked at")
        if camera is None:
            return
        try:
            frame = Frame(
                stamp_to_ns(header.stamp),
                camera,
                None if image is None else picture_of(image),
                None if depth is None else depth_of(depth),
            )
            sighting = self._target.tracker.step(
                frame, self._target.pose(header.frame_id, frame.stamp)
            )
        except ImageError as error:
            self._target.complain(str(error))
            return
        self._frame = frame
        self._target.send(frame.stamp, header.frame_id, sighting)
        if sighting is not None and self._region.get_subscription_count():
            self._region.publish(_region(sighting.candidate.box, frame))
        if self._annotated.get_subscription_count():
            self._show(frame, sighting, stamped)

    def _show(self, frame: Frame, sighting: Sighting | None, stamped: AnyImage) -> None:
        tracker = self._target.tracker
        if frame.picture is not None:
            picture = frame.picture.bgr
        else:
            assert frame.depth is not None
            picture = depth_picture(frame.depth, tracker.distances.max_distance)
        drawn = annotated(picture, tracker.tracks, sighting)
        self._annotated.publish(image_message(stamped.header, "bgr8", drawn))

    def _on_select(self, message: RegionOfInterest) -> None:
        self._looking.do(lambda: self._select(message))

    def _select(self, message: RegionOfInterest) -> None:
        box = Box(message.x_offset, message.y_offset, message.width, message.height)
        if self._frame is None or min(box.clipped(*_size(self._frame))[2:]) <= 0:
            self._target.complain(
                "the selection is not used: "
                + ("no image has come yet" if self._frame is None else f"{box} is empty")
            )
            return
        self._target.tracker.select(self._frame, box)


def _size(frame: Frame) -> tuple[int, int]:
    return frame.camera.width, frame.camera.height


def _region(box: Box, frame: Frame) -> RegionOfInterest:
    x, y, width, height = (round(number) for number in box.clipped(*_size(frame)))
    return RegionOfInterest(x_offset=x, y_offset=y, width=width, height=height)
