"""simulated_camera: images and depths of a rendered scene, seen by the camera of the head."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from rclpy.publisher import Publisher
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from head_tracking.parameters import parameter
from head_tracking.ros.kit.images import camera_info, compressed_message, image_message
from head_tracking.ros.kit.node_parameters import NodeParameters
from head_tracking.ros.kit.spinning import ClosingNode, steady_timer
from head_tracking.ros.kit.threads import Worker
from head_tracking.ros.kit.topics import OVERRIDABLE
from head_tracking.ros.targets.latest_target import LatestTarget
from head_tracking.scene import SCENES, TARGET, Renderer, SensorNoise, make_scene, with_target
from head_tracking.tf import Buffer, listening_buffer
from head_tracking.tf.messages import header
from head_tracking.transforms import Transform, TransformException, Vector3
from head_tracking.vision.camera import camera_with_view
from head_tracking.vision.opencv import cv2, require_opencv

_SILENT = 200_000_000  # ns without joint states: images show the last pose
_WITH_TARGET = (TARGET, "everything")
_NOISE = 4.0, 0.0015, 0.01
"""Of a Kinect: deviations of a pixel, and of a depth at 1 m [m]; share of missing depths."""

_SEED = 1


@dataclass(frozen=True, slots=True)
class SimulatedCameraParameters:
    """Camera and scene; the defaults are those of a Kinect, at half of its rate."""

    scene: str = parameter(
        "face",
        "The scene; target and everything also show a ball at target_point, unless the target was "
        "detected in these images.",
        choices=SCENES,
    )
    scene_frame: str = parameter("base_link", "Frame of the scene, with z up.", fixed=True)
    frame_id: str = parameter(
        "camera_optical_frame", "Optical frame: z forward, x right, y down.", fixed=True
    )
    width: int = parameter(
        640, "Size of the images.", unit="pixels", minimum=1, maximum=4096, fixed=True
    )
    height: int = parameter(
        480, "Size of the images.", unit="pixels", minimum=1, maximum=4096, fixed=True
    )
    horizontal_view: float = parameter(
        1.0, "Horizontal field of view.", unit="rad", minimum=0.05, maximum=2.8, fixed=True
    )
    rate: float = parameter(
        15.0, "Images per second.", unit="Hz", minimum=0.1, maximum=200.0, fixed=True
    )
    delay: float = parameter(
        0.08, "Delay between stamp and publication.", unit="s", minimum=0.0, maximum=5.0
    )
    depth_encoding: str = parameter(
        "16UC1",
        "Depths in millimetres or in metres; empty: none.",
        choices=("16UC1", "32FC1", ""),
    )


class _Exposure(NamedTuple):
    """Time [ns] and pose (`T_scene_optical`) of an image, and position of the target [m]."""

    stamp: int
    pose: Transform
    target: Vector3 | None


class SimulatedCameraNode(ClosingNode):
    """Publishes `image`, `image/compressed`, `depth` (aligned) and `camera_info`.

    Each is published while it has subscribers.

    An image has the pose and the stamp of the latest joint states. A thread renders the images, and
    skips images if it is too slow.

    Args:
        buffer: frames that another node of this process maintains; None: subscribe to them.
        defaults: of the parameters, instead of those of `SimulatedCameraParameters`.
        options: options of the node.

    Attributes:
        scene: the scene.
        renderer: renders the scene.
    """

    def __init__(
        self, buffer: Buffer | None = None, defaults: dict[str, Any] | None = None, **options: Any
    ) -> None:
        require_opencv()
        super().__init__("simulated_camera", **options)
        self._settings = NodeParameters(
            self, SimulatedCameraParameters, defaults=defaults, on_change=self._on_parameters
        )
        p = self._settings.value
        self._buffer = (buffer or listening_buffer(self)).core
        self._measured = 0  # stamp of the latest pose [ns]
        self._camera = camera_with_view(p.width, p.height, p.horizontal_view)
        self._shown = ""
        self._show()
        self._target = LatestTarget(self, self._buffer)
        self._target.place_in(p.scene_frame)
        rng = np.random.default_rng(_SEED)
        self._noise = SensorNoise((p.width, p.height), rng, *_NOISE)
        self._image = self.create_publisher(Image, "image", 5, qos_overriding_options=OVERRIDABLE)
        self._compressed = self.create_publisher(
            CompressedImage, "image/compressed", 5, qos_overriding_options=OVERRIDABLE
        )
        self._depth = self.create_publisher(Image, "depth", 5, qos_overriding_options=OVERRIDABLE)
        self._info = self.create_publisher(
            CameraInfo, "camera_info", 5, qos_overriding_options=OVERRIDABLE
        )
        self._worker: Worker[_Exposure] = Worker("simulated camera", self._draw)
        self.closing.callback(self._worker.close)
        steady_timer(self, 1.0 / p.rate, self._expose)

    def _on_parameters(self, _: SimulatedCameraParameters) -> None:
        self._worker.do(self._show)

    def _show(self) -> None:
        """Make the scene of the parameters, if it is another one."""
        p = self._settings.value
        if p.scene != self._shown:
            self._shown = p.scene
            self.scene = make_scene(p.scene, np.random.default_rng(_SEED))
            self.renderer = Renderer(self.scene, self._camera)

    def _expose(self) -> None:
        publishers = (self._image, self._compressed, self._depth, self._info)
        if not any(publisher.get_subscription_count() for publisher in publishers):
            return
        if self._buffer.model is None:
            self.get_logger().info("waiting for robot_description", throttle_duration_sec=2.0)
            return
        p, now = self._settings.value, self._now
        try:
            found = self._buffer.lookup_transform(p.scene_frame, p.frame_id)
        except TransformException as error:
            self.get_logger().warning(
                f"no image: {error}; see the parameters frame_id and scene_frame",
                throttle_duration_sec=2.0,
            )
            return
        is_recent = 0 <= now - found.stamp < _SILENT
        if is_recent and found.stamp == self._measured:
            return
        self._measured = found.stamp
        target = self._target.latest() if self._shown in _WITH_TARGET else None
        # a ball at a target that was detected in these images would hide it
        is_own = target is not None and target.target.frame_id == p.frame_id
        point = None if target is None or is_own else target.point
        stamp = found.stamp if is_recent else now
        self._worker.offer(_Exposure(stamp, found.transform, point))

    @property
    def _now(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _draw(self, exposure: _Exposure) -> None:
        """Render the images that have subscribers, and publish them after the delay."""
        p = self._settings.value
        head = header(exposure.stamp, p.frame_id)
        messages: list[tuple[Publisher, Any]] = []
        if self._info.get_subscription_count():
            messages.append((self._info, camera_info(head, self._camera)))
        wanted = [one for one in (self._image, self._compressed) if one.get_subscription_count()]
        wants_depth = p.depth_encoding != "" and self._depth.get_subscription_count() > 0
        if wanted or wants_depth:
            target = exposure.target
            self.renderer.scene = self.scene if target is None else with_target(self.scene, target)
            seen = self.renderer.render(exposure.pose, exposure.stamp * 1e-9, depth=wants_depth)
        if wants_depth:
            depth: npt.NDArray[Any] = self._noise.depth(seen.depth)
            if p.depth_encoding == "16UC1":
                depth = cv2.multiply(depth, 1000.0, dtype=cv2.CV_16U)  # 0: missing
            messages.append((self._depth, image_message(head, p.depth_encoding, depth)))
        if wanted:
            image = image_message(head, "bgr8", self._noise.picture(seen.picture))
            for one in wanted:
                messages.append((one, image if one is self._image else compressed_message(image)))
        taken = (self._now - exposure.stamp) * 1e-9
        self._worker.do(lambda: _publish(messages), p.delay - min(p.delay, max(0.0, taken)))


def _publish(messages: list[tuple[Publisher, Any]]) -> None:
    for publisher, message in messages:
        publisher.publish(message)
