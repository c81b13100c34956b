"""A head that follows what its simulated camera sees, in simulated time."""

import math
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import rclpy
from lockstep import PAN, TILT, World
from rendered_frames import position, seen_surface

from head_tracking.gaze import PanTiltHead
from head_tracking.ros.head.head_tracker import HeadTrackerNode
from head_tracking.ros.targets.simulated_camera import SimulatedCameraNode
from head_tracking.ros.targets.visual_target import VisualTargetNode
from head_tracking.scene import Wall
from head_tracking.share import robot_file
from head_tracking.tf.conversions import stamp_to_ns, vector
from head_tracking.tracking import ErrorStatistics
from head_tracking.transforms import Transform, load_robot_model

CAMERA = "camera_optical_frame"
SETTLING = 3.0  # s
RATE = 30.0  # images a second
_SAMPLE = 10_000_000  # ns


def tutorial_law() -> dict[str, Any]:
    """The values of tutorial part 2."""
    gains = {"k_pan": 1.5, "k_tilt": 1.5, "max_joint_speed": 0.5}
    return {"law": "speed", "rate": 10.0, **gains}


@dataclass
class Pursuit:
    """What came of a run."""

    # angle between the camera's axis and the target, by the servos' true angles [rad]
    errors: ErrorStatistics = field(default_factory=ErrorStatistics)
    # how far the published points were from what they should be [m]
    misses: list[float] = field(default_factory=list)
    images: int = 0  # how many the camera took
    picture: Any = None  # the last annotated image


def pursue(
    scene: str,  # of the simulated camera
    followed: str,  # the name of the thing in it that should be followed
    target: dict[str, Any],  # parameters of visual_target
    tracker: dict[str, Any],  # parameters of head_tracker
    *,
    duration: float = 20.0,  # [s]
    camera: dict[str, Any] | None = None,  # parameters of simulated_camera
    hide: tuple[float, float] | None = None,  # from and until when [s] all things are out of sight
) -> Pursuit:
    """Runs camera, target and tracker of kinectbot together."""
    model = load_robot_model(robot_file("kinectbot"))
    world, result = World(model), Pursuit()
    head = PanTiltHead(model, PAN.joint_name, TILT.joint_name, CAMERA)
    T_head_scene = model.transform(head.base_frame, "base_link", {})
    poses: dict[int, Transform] = {}
    rclpy.init()
    seeing = {"scene": scene, "rate": RATE, **(camera or {})}
    eye = world.make(SimulatedCameraNode, seeing, buffer=world.buffer)
    world.make(VisualTargetNode, target, buffer=world.buffer)
    world.make(HeadTrackerNode, tracker, loop=world.loop)
    seen = eye.scene

    def exposed() -> None:
        positions = dict(zip((PAN.joint_name, TILT.joint_name), world.true, strict=True))
        poses[world.now] = model.transform("base_link", CAMERA, positions)

    def taken() -> None:
        result.images += 1

    def on_target(message: Any) -> None:
        stamp = stamp_to_ns(message.header.stamp)
        found = poses[stamp] @ vector(message.point)
        truth = seen_surface(seen, followed, stamp * 1e-9, poses[stamp])
        result.misses.append(math.dist(found, truth))

    def on_picture(message: Any) -> None:
        result.picture = message

    def judge() -> None:
        if world.seconds >= SETTLING:
            point = T_head_scene @ position(seen, followed, world.now * 1e-9)
            result.errors.add(head.miss(point, *world.true))

    world.every(round(1e9 * world.period), exposed)
    world.every(round(1e9 / RATE), taken)
    world.every(_SAMPLE, judge)
    world.listen("/target_point", on_target)
    world.listen("/visual_target/image", on_picture)
    if hide is not None:
        shown = dict(seen)
        walls = {name: thing for name, thing in shown.items() if isinstance(thing, Wall)}
        for when, things in zip(hide, (walls, shown), strict=True):
            # the truth about what the camera does not see stays known
            world.at(world.now + round(when * 1e9), partial(setattr, eye, "scene", things))
    try:
        world.run(duration)
    finally:
        rclpy.try_shutdown()
    return result
