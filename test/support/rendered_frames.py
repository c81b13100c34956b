"""Frames of a scene, as detectors get them, with the truth about it."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from head_tracking.scene import Ball, Board, Renderer, Scene, SensorNoise, make_scene
from head_tracking.transforms import RobotModel, Transform, Vector3
from head_tracking.vision import (
    DETECTORS,
    Box,
    Camera,
    DepthImage,
    DistanceParameters,
    Frame,
    IdentityParameters,
    Picture,
    Sighting,
    VisualTracker,
    camera_with_view,
)

PERIOD = 1 / 30  # s


def position(scene: Scene, name: str, time: float) -> Vector3:
    """The middle of a ball, or the anchor of a board [m]."""
    thing = scene[name]
    assert isinstance(thing, Ball | Board), f"{name} is at rest"
    return thing.path(time)


def seen_surface(scene: Scene, name: str, time: float, camera: Transform) -> Vector3:
    """The point that a depth camera measures [m]; of a ball, on its visible side."""
    thing, middle = scene[name], position(scene, name, time)
    if not isinstance(thing, Ball):
        return middle
    eye = camera.translation
    share = thing.radius / math.dist(eye, middle)
    x, y, z = (m + (c - m) * share for m, c in zip(middle, eye, strict=True))
    return x, y, z


@dataclass
class View:
    """A camera on a robot's head that turns to and fro."""

    scene: Scene  # what it looks at
    model: RobotModel  # carries it
    camera: Camera  # what it is
    swing: float = 0.4  # amplitude of the pan [rad], at 0.2 Hz.
    depth: str = "16UC1"  # "16UC1", "32FC1" or "" for none
    noise: float = 4.0  # of a pixel
    seed: int = 1  # of the noise

    def pose(self, time: float) -> Transform:
        """`T_scene_optical`."""
        joints = {
            "head_pan_joint": self.swing * math.sin(math.tau * 0.2 * time),
            "head_tilt_joint": -0.1,
        }
        return self.model.transform("base_link", "camera_optical_frame", joints)

    def frames(self, count: int, start: float = 0.0) -> Iterator[tuple[float, Frame, Transform]]:
        """Time [s], frame and the camera's pose."""
        renderer = Renderer(self.scene, self.camera)
        size = (self.camera.width, self.camera.height)
        noise = SensorNoise(size, np.random.default_rng(self.seed), self.noise, 0.0015, 0.01)
        for i in range(count):
            time = start + i * PERIOD
            pose = self.pose(time)
            seen = noise(renderer.render(pose, time))
            depth: Any = None
            if self.depth == "16UC1":
                depth = DepthImage(np.nan_to_num(seen.depth * 1000).astype(np.uint16))
            elif self.depth:
                depth = DepthImage(seen.depth)
            frame = Frame(round((time + 1) * 1e9), self.camera, Picture(seen.picture), depth)
            yield time, frame, pose

    def box(self, name: str, time: float, width: float) -> Box:
        """A square around a thing, in pixels."""
        pixel = self.camera.pixel(self.pose(time).inverse() @ position(self.scene, name, time))
        assert pixel is not None
        return Box(pixel[0] - width / 2, pixel[1] - width / 2, width, width)


def make_tracker(what: str, parameters: Any = None, **distances: float) -> VisualTracker:
    """Return a tracker of what one of the detectors finds."""
    detector = DETECTORS[what].make(parameters)
    return VisualTracker(detector, DistanceParameters(**distances), IdentityParameters())


def drawn(scene: str) -> Scene:
    """Return one of the package's scenes, the same each time."""
    return make_scene(scene, np.random.default_rng(5))


SMALL = camera_with_view(320, 240, 1.0)
KINECT = camera_with_view(640, 480, 1.0)


@dataclass
class Watched:
    """What a tracker made of some frames."""

    sightings: list[Sighting | None]  # of each frame
    misses: list[float]  # how far each sighting's point was from where it should be [m]

    @property
    def numbers(self) -> list[int]:
        """Whom it followed, one after the other."""
        found = [s.number for s in self.sightings if s is not None]
        return [n for i, n in enumerate(found) if i == 0 or found[i - 1] != n]


def watch(
    tracker: VisualTracker,  # looks for something
    view: View,  # gives the frames
    name: str,  # the thing that it should find
    count: int,  # how many frames
    *,
    # width of a rectangle [pixels] that is drawn around the thing at first; 0: none
    select: float = 0.0,
    centre: bool = False,  # the point should be the middle of the thing, not its surface
) -> Watched:
    """Shows frames to a tracker."""
    result = Watched([], [])
    for i, (time, frame, pose) in enumerate(view.frames(count)):
        if select and i == 0:
            tracker.select(frame, view.box(name, time, select))
        sighting = tracker.step(frame, pose)
        result.sightings.append(sighting)
        if sighting is not None:
            truth = (
                position(view.scene, name, time)
                if centre
                else seen_surface(view.scene, name, time, pose)
            )
            result.misses.append(math.dist(pose @ sighting.point, truth))
    return result
