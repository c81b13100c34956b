"""A head that follows what its simulated camera sees, in simulated time."""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import rclpy
import yaml
from lockstep import PAN, TILT, World

from head_tracking.gaze import PanTiltHead
from head_tracking.nodes.head_tracker import HeadTrackerNode
from head_tracking.nodes.simulated_camera import SimulatedCameraNode
from head_tracking.nodes.visual_target import VisualTargetNode
from head_tracking.share import robot_file, share_directory
from head_tracking.tracking import ErrorStatistics
from head_tracking.transforms import load_robot_model

CAMERA = "camera_optical_frame"
SETTLING = 3.0  # s
_SAMPLE = 10_000_000  # ns


def head_yaml() -> dict[str, Any]:
    """The values of config/head.yaml for the tracker."""
    text = (Path(share_directory()) / "config" / "head.yaml").read_text()
    parameters: dict[str, Any] = yaml.safe_load(text)["/**/head_tracker"]["ros__parameters"]
    return parameters


def tutorial_law() -> dict[str, Any]:
    """The values of tutorial part 2."""
    gains = {"k_pan": 1.5, "k_tilt": 1.5, "max_joint_speed": 0.5}
    return head_yaml() | {"law": "speed", "rate": 10.0, **gains}


@dataclass
class Pursuit:
    """What came of a run.

    Attributes:
        errors: angle between the camera's axis and the target, by the servos' true angles [rad].
        misses: how far the published points were from what they should be [m].
        published: targets.
        expected: images.
        picture: the last annotated image.
    """

    errors: ErrorStatistics = field(default_factory=ErrorStatistics)
    misses: list[float] = field(default_factory=list)
    published: int = 0
    expected: int = 0
    picture: Any = None


def pursue(
    scene: str,
    followed: str,
    target: dict[str, Any],
    tracker: dict[str, Any],
    *,
    duration: float = 20.0,
    camera: dict[str, Any] | None = None,
    hide: tuple[float, float] | None = None,
    robot: str = "kinectbot",
) -> Pursuit:
    """Runs camera, target and tracker together.

    Args:
        scene: of the simulated camera.
        followed: the name of the thing in it that should be followed.
        target: parameters of visual_target.
        tracker: parameters of head_tracker.
        duration: [s].
        camera: parameters of simulated_camera.
        hide: from and until when [s] the things are out of sight.
        robot: the robot.
    """
    model = load_robot_model(robot_file(robot))
    world = World(model)
    result = Pursuit()
    head = PanTiltHead(model, PAN.joint_name, TILT.joint_name, CAMERA)
    rclpy.init()
    try:
        eye = world.make(
            SimulatedCameraNode,
            {"scene": scene, **(camera or {})},
            buffer=world.buffer,
            true_position=world.true_position,
        )
        looker = world.make(VisualTargetNode, target, buffer=world.buffer)
        turner = world.make(HeadTrackerNode, tracker, buffer=world.buffer)
        seen = eye._renderer.scene

        def pose(stamp: int) -> Any:
            positions = {joint.joint_name: turned[stamp][i] for i, joint in enumerate((PAN, TILT))}
            return model.transform("base_link", CAMERA, positions)

        turned: dict[int, tuple[float, float]] = {}

        def on_image(message: Any) -> None:
            result.picture = message

        def on_target(message: Any) -> None:
            stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
            T_base_camera = pose(stamp)
            point = (message.point.x, message.point.y, message.point.z)
            truth = seen.seen_surface(followed, stamp * 1e-9, T_base_camera)
            result.misses.append(math.dist(T_base_camera @ point, truth))
            result.published += 1

        def where() -> tuple[float, float]:
            return world.true_position(PAN.joint_name), world.true_position(TILT.joint_name)

        def on_exposure(message: Any) -> None:
            result.expected += 1

        take = eye._take

        def sample() -> None:
            if world.seconds < SETTLING:
                return
            point = seen.position(followed, world.now * 1e-9)
            in_base = model.transform(head.base_frame, "base_link", {}) @ point
            result.errors.add(head.miss(in_base, *where()))

        # the truth about the joints at every image's stamp
        def noted() -> None:
            turned[world.now] = where()

        world.every(round(1e9 / eye._settings.value.rate), noted)
        world.every(_SAMPLE, sample)
        world.listen("/target_point", on_target)
        world.listen("/image", on_exposure)
        world.listen("/visual_target/image", on_image)
        if hide is not None:
            things = dict(seen.things)

            def vanish() -> None:
                for name in [n for n, thing in things.items() if hasattr(thing, "path")]:
                    seen.things.pop(name)

            def appear() -> None:
                seen.things.update(things)

            world.at(world.now + round(hide[0] * 1e9), vanish)
            world.at(world.now + round(hide[1] * 1e9), appear)
        del take
        world.run(duration)
        for node in (turner, looker, eye):
            node.destroy_node()
    finally:
        rclpy.try_shutdown()
    return result


_ = closing
