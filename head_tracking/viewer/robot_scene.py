"""A robot in the 3D scene: shapes that move with its joints, and its frames on demand."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import viser
from PIL import Image, ImageChops, ImageDraw, ImageFilter

from head_tracking.transforms import JointType, RobotModel, Rotation, Transform
from head_tracking.transforms.robot_model import walk
from head_tracking.viewer.shapes import Box, Cylinder, Look, Mesh, Missing, Shape, Sphere, triangles

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

    Attributes:
        model: the robot.
        corners: of the box around it with its joints at 0, shape (8, 3) [m].
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
        solid = triangles(model, look)
        self.corners = _box(solid.reshape(-1, 3))
        self._shadow = add_shadow(scene, "/shadow", solid, 0.0)

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
        if self._shadow is not None:
            self._shadow.remove()

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


def _box(points: Any) -> Any:
    """The corners of the box around points, shape (8, 3) [m]; of a small one if there are none."""
    points = points if len(points) else np.array([(-0.2, -0.2, 0.0), (0.2, 0.2, 0.4)])
    return np.array(
        list(itertools.product(*zip(points.min(axis=0), points.max(axis=0), strict=True)))
    )


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


_FRAMES = "/frames"


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
                name = f"{_FRAMES}/{node_name(frame)}"
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


_PIXELS = 256
_HIGH = 0.12  # m: what is higher than this casts a paler and softer shadow
_ABOVE = 0.002  # m above the ground, so that they don't flicker through each other


def add_shadow(
    scene: viser.SceneApi, name: str, triangles: npt.NDArray[np.float64], ground: float
) -> Any:
    """Draws it; None if there is nothing to cast one.

    Args:
        scene: gets the shadow.
        name: in the scene.
        triangles: of the robot, shape (N, 3, 3) [m].
        ground: its height [m].
    """
    if not len(triangles):
        return None
    flat = triangles[..., :2]
    low, high = flat.min(axis=(0, 1)), flat.max(axis=(0, 1))
    size = 1.6 * float((high - low).max())
    middle = (low + high) / 2.0
    pixels = (flat - middle) / size * _PIXELS + _PIXELS / 2
    near = triangles[..., 2].min(axis=1) < ground + _HIGH
    alpha = ImageChops.lighter(
        _blurred(pixels, 0.05 * _PIXELS, 60), _blurred(pixels[near], 0.02 * _PIXELS, 95)
    )
    picture = np.zeros((_PIXELS, _PIXELS, 4), np.uint8)
    picture[..., 3] = np.asarray(alpha)
    return scene.add_image(
        name, picture, size, size, format="png", cast_shadow=False, receive_shadow=False,
        position=(*middle.tolist(), ground + _ABOVE),
    )  # fmt: skip


def _blurred(pixels: npt.NDArray[np.float64], radius: float, darkness: int) -> Image.Image:
    picture = Image.new("L", (_PIXELS, _PIXELS))
    draw = ImageDraw.Draw(picture)
    for triangle in pixels:
        draw.polygon([(x, y) for x, y in triangle.tolist()], fill=darkness)
    return picture.filter(ImageFilter.GaussianBlur(radius))
