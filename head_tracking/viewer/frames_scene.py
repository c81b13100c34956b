"""Frames in the 3D scene: axes and names, of the robot's links and of everything else."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import viser

from head_tracking.transforms import Transform
from head_tracking.viewer.robot_scene import RobotScene, node_name, wxyz

_ROOT = "/frames"


class FramesScene:
    """Draws the frames that are wanted.

    Args:
        scene: gets the nodes.
        robot: frames that are its links move with it.
    """

    def __init__(self, scene: viser.SceneApi, robot: RobotScene) -> None:
        self._scene = scene
        self._robot = robot
        self._wanted: frozenset[str] = frozenset()
        self._labels: dict[str, Any] = {}
        self._outer: dict[str, Any] = {}

    def want(self, frames: Iterable[str]) -> None:
        """Shows these frames, each with its name, and no others."""
        self._wanted = frozenset(frames)
        links = self._wanted & set(self._robot.model.links)
        self._robot.show_axes(links)
        for link in self._labels.keys() - links:
            self._labels.pop(link).remove()
        for link in links - self._labels.keys():
            self._labels[link] = self._scene.add_label(f"{self._robot.path(link)}/label", link)

    def show(self, frames: Mapping[str, Transform]) -> None:
        """Draws the wanted ones of these frames that are outside the model, in its root."""
        shown = self._wanted & frames.keys()
        for frame in self._outer.keys() - shown:
            self._outer.pop(frame).remove()
        for frame in shown:
            node = self._outer.get(frame)
            if node is None:
                name = f"{_ROOT}/{node_name(frame)}"
                node = self._outer[frame] = self._scene.add_frame(
                    name, axes_length=0.08, axes_radius=0.003
                )
                self._scene.add_label(f"{name}/label", frame)
            node.wxyz = wxyz(frames[frame].rotation)
            node.position = frames[frame].translation

    def remove(self) -> None:
        """Takes all frames out of the scene."""
        self.want(())
        self.show({})
