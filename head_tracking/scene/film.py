"""Images of a scene in real time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np

from head_tracking.scene.render import Renderer
from head_tracking.scene.scenes import make_scene
from head_tracking.transforms import Transform
from head_tracking.vision.camera import camera_with_view
from head_tracking.vision.camera_follower import DEFAULT_VIEW
from head_tracking.vision.images import Pixels

_SIZE, _PERIOD = (320, 240), 1.0 / 15.0  # s


def film(scene: str, pose: Callable[[float], Transform]) -> Iterator[tuple[float, Pixels]]:
    """Yield 15 images a second of 320 by 240 pixels, with their times [s, as time.time()].

    The camera has `DEFAULT_VIEW`.

    Args:
        scene: one of `SCENES`.
        pose: returns the pose of the camera, `T_scene_optical`, at a time.
    """
    renderer = Renderer(
        make_scene(scene, np.random.default_rng(1)), camera_with_view(*_SIZE, DEFAULT_VIEW)
    )
    due = time.monotonic()
    while True:
        stamp = time.time()
        yield stamp, renderer.render(pose(stamp), stamp, depth=False).picture
        due = max(due + _PERIOD, time.monotonic())
        time.sleep(max(0.0, due - time.monotonic()))
