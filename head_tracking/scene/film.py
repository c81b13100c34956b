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

_SIZE = 320, 240


def film(
    scene: str, pose: Callable[[float], Transform], rate: float = 15.0, seed: int = 1
) -> Iterator[tuple[float, Pixels]]:
    """Yield images of 320 by 240 pixels and `DEFAULT_VIEW`, with their times [s, as time.time()].

    Args:
        scene: one of `SCENES`.
        pose: returns the pose of the camera, `T_scene_optical`, at a time.
        rate: images per second.
        seed: seed of the room.
    """
    renderer = Renderer(
        make_scene(scene, np.random.default_rng(seed)), camera_with_view(*_SIZE, DEFAULT_VIEW)
    )
    due = time.monotonic()
    while True:
        stamp = time.time()
        yield stamp, renderer.render(pose(stamp), stamp, depth=False).picture
        due = max(due + 1.0 / rate, time.monotonic())
        time.sleep(max(0.0, due - time.monotonic()))
