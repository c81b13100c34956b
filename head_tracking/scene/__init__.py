"""Scenes with moving objects, rendered for a simulated camera."""

from head_tracking.scene.film import film
from head_tracking.scene.objects import Ball, Board, Scene, Swing, Wall
from head_tracking.scene.render import Renderer
from head_tracking.scene.scenes import SCENES, TARGET, make_scene, with_target
from head_tracking.scene.sensor import SensorNoise

__all__ = [
    "SCENES",
    "TARGET",
    "Ball",
    "Board",
    "Renderer",
    "Scene",
    "SensorNoise",
    "Swing",
    "Wall",
    "film",
    "make_scene",
    "with_target",
]
