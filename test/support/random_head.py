"""Heads whose cameras sit elsewhere than the model says, and what these see of a marker."""

import math
from typing import NamedTuple

import numpy as np

from head_tracking.calibration import Calibration
from head_tracking.calibration.geometry import (
    PARAMETERS,
    HeadGeometry,
    Residuals,
    rotation_matrices,
)
from head_tracking.calibration.solver import View
from head_tracking.share import robot_file
from head_tracking.transforms import load_robot_model
from head_tracking.vision.camera import camera_with_view

SIZE = 0.16  # m
CAMERA = camera_with_view(640, 480, math.radians(60.0))
READING = 0.0015  # rad; deviation of the joints' readings
RESIDUALS = Residuals(
    500.0, np.zeros((2, 2)), np.array([(30.0, 40.0), (-40.0, 30.0)]), np.array([(0.5, 0), (0, 0.5)])
)
"""Of a solution that was not computed: 0.1 rad before, 0.001 rad after."""
_SIGNS = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
_AHEAD = 0.5  # rad: how far a held-out view is aside at most


def kinectbot_geometry() -> HeadGeometry:
    """Return that of the robot on which calibrations are tried."""
    model = load_robot_model(robot_file("kinectbot"))
    return HeadGeometry(model, "head_pan_joint", "head_tilt_joint", "camera_optical_frame")


class Seen(NamedTuple):
    """A head and its views."""

    changes: np.ndarray  # how it differs from the model, shape (12,)
    views: list[View]  # for a calibration, in a random order
    # others, without noise: pan, tilt [rad], and where the marker is by the true head, in the
    # optical frame, shape (3,) [m]
    held_out: list[tuple[float, float, np.ndarray]]


def random_head(
    geometry: HeadGeometry,  # of the model
    seed: int,  # chooses them
    noise: float,  # of a corner [px]
    zeros: float = 0.0,  # deviation of the joints' zeros [rad]
    play: float = 0.0,  # of both joints, between encoder and camera, from side to side [rad]
    points: int = 0,  # show so many points 1 to 4 m away instead of a marker
) -> Seen:
    """Draw a head that is about 5 degrees and 10 mm wrong, and a marker 1 to 3 m away."""
    rng = np.random.default_rng(seed)
    changes = np.zeros(12)
    changes[:3], changes[3:6] = rng.normal(0.0, math.radians(5.0), 3), rng.normal(0.0, 0.01, 3)
    changes[6] = rng.normal(0.0, math.radians(1.0))
    changes[8:10] = rng.normal(0.0, zeros, 2)
    changes[10:] = play
    azimuth, elevation, away = rng.uniform(-0.4, 0.4), rng.uniform(-0.2, 0.2), rng.uniform(1.0, 3.0)
    level = away * math.cos(elevation)
    middle = np.array(
        [level * math.cos(azimuth), level * math.sin(azimuth), away * math.sin(elevation) + 0.1]
    )
    outwards = -middle / np.linalg.norm(middle)
    right = np.cross((0.0, 0.0, 1.0), outwards)
    right /= np.linalg.norm(right)
    facing = np.stack([right, np.cross(outwards, right), outwards], axis=1)
    corners = (
        middle
        + 0.5 * SIZE * _SIGNS @ (facing @ rotation_matrices(rng.normal(0.0, 0.3, (1, 3)))[0]).T
    )
    shapes = [corners]
    if points:
        asides = rng.uniform(-0.35, 0.35, (points, 2)) * (points > 1)
        spheres = [(azimuth + aside, elevation + up) for aside, up in asides]
        shapes = [
            rng.uniform(1.0, 4.0)
            * np.array([[math.cos(a) * math.cos(e), math.sin(a) * math.cos(e), math.sin(e)]])
            for a, e in spheres
        ]

    def optical(pan: float, tilt: float, points: np.ndarray) -> np.ndarray:
        (turn,), (place,) = geometry.cameras(changes, np.array([pan]), np.array([tilt]))
        return np.asarray((points - place) @ turn)

    def seen(pan: float, tilt: float, shape: np.ndarray = corners) -> np.ndarray | None:
        pixels = [CAMERA.pixel(point) for point in optical(pan, tilt, shape).tolist()]
        inside = all(p is not None and 3 < p[0] < 636 and 3 < p[1] < 476 for p in pixels)
        return np.array(pixels) if inside else None

    grid = [(p, t) for t in np.linspace(-0.3, 0.3, 5) for p in np.linspace(-0.4, 0.4, 5)]
    rng.shuffle(grid)
    views = []
    before, turned = grid[0], np.zeros(2)
    for aside, up in grid:
        step = np.sign(np.subtract((aside, up), before))
        before, turned = (aside, up), np.where(step, step, turned)
        pan, tilt = azimuth + aside, up - elevation
        wrong = rng.normal(0.0, READING, 2)
        read = np.array((pan, tilt)) + wrong + 0.5 * play * turned
        for number, shape in enumerate(shapes):
            found = seen(pan, tilt, shape)
            if found is not None:
                found = found + rng.normal(0.0, noise, found.shape)
                directions = tuple(turned.astype(int).tolist())
                views.append(View(read[0], read[1], number, found, directions))
    held_out = []
    for _ in range(60):
        pan = azimuth + rng.uniform(-_AHEAD, _AHEAD)
        tilt = rng.uniform(-_AHEAD, _AHEAD) - elevation
        if seen(pan, tilt) is not None:
            held_out.append((pan, tilt, optical(pan, tilt, middle)))
    return Seen(changes, views, held_out)


def changes_of(calibration: Calibration) -> np.ndarray:
    """Return the values of `PARAMETERS`, 0 where one was not estimated, shape (12,)."""
    found = [calibration.estimates.get(each.name) for each in PARAMETERS]
    return np.array([0.0 if each is None else each.value for each in found])


def pointing_error(geometry: HeadGeometry, head: Seen, changes: np.ndarray) -> float:
    """Return by how much a calibrated head disagrees with itself on where the marker is [rad], rms.

    Each held-out view tells a place; a head without errors tells the same one each time.
    """
    places = []
    for pan, tilt, seen in head.held_out:
        (turn,), (place,) = geometry.cameras(changes, np.array([pan]), np.array([tilt]))
        places.append(place + turn @ seen)
    middle = np.mean(places, axis=0)
    apart = np.linalg.norm(places - middle, axis=1) / np.linalg.norm(middle)
    return float(np.sqrt((apart**2).mean()))
