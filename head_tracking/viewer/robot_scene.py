"""A robot in the 3D scene: shapes that move with its joints, and its frames on demand."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import viser

from head_tracking.transforms import JointType, RobotModel, Rotation, Transform
from head_tracking.transforms.robot_model import walk
from head_tracking.viewer.shapes import Box, Cylinder, Look, Mesh, Missing, Shape, Sphere

ROOT = "/robot"

_TURNED = 1e-5  # rad or m: less is not worth a message
_MISSING_SIZE = 0.05  # m
_MISSING_COLOUR = (230, 60, 60)


class RobotScene:
    """Shows a robot at the joint positions that it is told.

    Every link is a node below its parent's, so that a joint that moves is one message, however
    many links it carries.

    Args:
        scene: gets the nodes.
        model: the robot.
        look: its shapes.
    """

    def __init__(self, scene: viser.SceneApi, model: RobotModel, look: Look) -> None:
        self.model = model
        self._scene = scene
        self._top = scene.add_frame(ROOT, show_axes=False)
        self._paths = _paths(model)
        self._shown: dict[str, float] = {}
        self._nodes: dict[str, Any] = {}
        for link, path in self._paths.items():
            self._nodes[link] = scene.add_frame(
                path, show_axes=False, axes_length=0.08, axes_radius=0.003
            )
        for joint in model.joints.values():
            self._place(joint.child, self._local(joint.name, 0.0))
        for number, shape in enumerate(look.shapes):
            _add_shape(scene, f"{self._paths[shape.link]}/shape_{number}", shape)

    def path(self, link: str) -> str:
        """The scene's name of a link; what is put below it moves with it."""
        return self._paths[link]

    def show(self, positions: Mapping[str, float]) -> None:
        """Moves the joints to these positions [rad or m]; joints left out stay."""
        for joint in self.model.joints.values():
            if not joint.moves:
                continue
            leader = self.model.leader(joint.name)
            position = positions.get(leader.joint)
            if position is None or not math.isfinite(position):
                continue
            if abs(position - self._shown.get(joint.name, math.inf)) < _TURNED:
                continue
            self._shown[joint.name] = position
            transform = self._local(joint.name, position)
            if joint.type is JointType.PRISMATIC:
                self._place(joint.child, transform)
            else:
                self._nodes[joint.child].wxyz = wxyz(transform.rotation)

    def unknown_joints(self) -> tuple[str, ...]:
        """Joints of which no position was ever told; they are shown at 0."""
        return tuple(
            name
            for name, joint in self.model.joints.items()
            if joint.moves and name not in self._shown
        )

    def show_axes(self, links: frozenset[str]) -> None:
        """Shows the axes of these links and of no others."""
        for link, node in self._nodes.items():
            node.show_axes = link in links

    def remove(self) -> None:
        """Takes the robot out of the scene."""
        self._top.remove()

    def _local(self, joint: str, position: float) -> Transform:
        """The child of a joint in its parent, with the joint's leader at `position`."""
        found = self.model.joints[joint]
        chain = self.model.chain(found.parent, found.child)
        return chain.transform(*[position for _ in chain.joints])

    def _place(self, link: str, transform: Transform) -> None:
        node = self._nodes[link]
        node.wxyz, node.position = wxyz(transform.rotation), transform.translation


def wxyz(rotation: Rotation) -> tuple[float, float, float, float]:
    """A rotation in the order of viser."""
    x, y, z, w = rotation
    return w, x, y, z


def node_name(frame: str) -> str:
    """A frame's name as one part of a scene name."""
    return frame.replace("/", ":")


def _paths(model: RobotModel) -> dict[str, str]:
    paths: dict[str, str] = {}
    for entry in walk(model):
        joint = model.parent_joint(entry.link)
        above = ROOT if joint is None else paths[joint.parent]
        paths[entry.link] = f"{above}/{node_name(entry.link)}"
    return paths


def _add_shape(scene: viser.SceneApi, name: str, shape: Shape) -> None:
    r, g, b, a = shape.rgba
    place: dict[str, Any] = {
        "wxyz": wxyz(shape.T_link_shape.rotation),
        "position": shape.T_link_shape.translation,
    }
    paint: dict[str, Any] = {
        "color": (round(255 * r), round(255 * g), round(255 * b)),
        "opacity": None if a >= 1.0 else a,
    }
    match shape.geometry:
        case Box(size):
            scene.add_box(name, dimensions=size, **paint, **place)
        case Cylinder(radius, length):
            scene.add_cylinder(name, radius, length, **paint, **place)
        case Sphere(radius):
            scene.add_icosphere(name, radius, subdivisions=2, **paint, **place)
        case Mesh(mesh, True):
            scene.add_mesh_trimesh(name, mesh, **place)
        case Mesh(mesh, _):
            scene.add_mesh_simple(name, mesh.vertices, mesh.faces, **paint, **place)
        case Missing():
            size = (_MISSING_SIZE,) * 3
            scene.add_box(name, _MISSING_COLOUR, size, wireframe=True, **place)
