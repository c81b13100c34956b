"""Where a person points: in the camera's picture, or on the ground of the scene."""

from __future__ import annotations

import math

import numpy as np

from head_tracking.transforms import Transform, Vector3
from head_tracking.viewer.other_topics import Picture
from head_tracking.vision.camera import camera_with_view

_FARTHEST = 20.0  # m: beyond that the ground is the horizon


def point_in_picture(
    picture: Picture,
    share: tuple[float, float],
    T_root_camera: Transform,
    distance: float,
    horizontal_view: float,
) -> Vector3:
    """The point that a place in a picture shows, in the robot's root [m].

    Args:
        picture: with the calibration of its camera, if there is one.
        share: of its width and of its height, from the upper left corner.
        T_root_camera: where the camera's optical frame was when it took the picture.
        distance: of the point from the camera [m], which a picture does not tell.
        horizontal_view: of a camera without calibration, from side to side [rad].
    """
    height, width = picture.pixels.shape[:2]
    camera = picture.camera or camera_with_view(width, height, horizontal_view)
    x, y = camera.ray((share[0] * width - 0.5, share[1] * height - 0.5))
    depth = distance / math.hypot(x, y, 1.0)
    return T_root_camera @ (x * depth, y * depth, depth)


def point_on_ground(origin: Vector3, direction: Vector3, height: float = 0.0) -> Vector3 | None:
    """Where a line of sight meets the ground; None if it never does, or too far away.

    Args:
        origin: of the line [m].
        direction: of the line.
        height: of the ground [m].
    """
    down = direction[2]
    if abs(down) < 1e-9:
        return None
    along = (height - origin[2]) / down
    step = along * np.asarray(direction)
    if along <= 0.0 or float(np.linalg.norm(step)) > _FARTHEST:
        return None
    x, y, z = (np.asarray(origin) + step).tolist()
    return x, y, z
