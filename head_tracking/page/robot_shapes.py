"""A robot for the browser: its joints, the shapes of its links, and its head."""

from __future__ import annotations

import io
import logging
import math
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from ament_index_python.packages import get_package_share_directory

from head_tracking.gaze import PanTiltHead
from head_tracking.recording.recording import Observation
from head_tracking.share import PACKAGE, share_directory
from head_tracking.transforms import RobotModel, Transform
from head_tracking.transforms.urdf import import_yourdfpy

_GREY = [0.6, 0.6, 0.62, 1.0]
_LARGEST = 1e3  # m: a larger shape is a mistake


class RobotForBrowser:
    """A robot for the browser. Shapes that can't be shown become notices.

    Transforms are [x, y, z, qx, qy, qz, qw] in metres. `leader` of a joint is the index in
    `independent` of the joint whose position it follows, times `ratio` plus `offset`.

    The address of a mesh is `meshes_at` and its number.

    Attributes:
        about: its joints, shapes, head and notices, for JSON.
        meshes: binary STL; of kind `coloured`: binary glTF.
    """

    def __init__(self, model: RobotModel, head: PanTiltHead | None, meshes_at: str) -> None:
        self._names, self._head = model.independent_joints, head
        limits = {name: joint.limits for name, joint in model.joints.items()}
        if head is not None:
            limits |= {head.pan_joint: head.pan_limits, head.tilt_joint: head.tilt_limits}
        joints = []
        for joint in model.joints.values():
            leader, ends = model.leader(joint.name), limits[joint.name]
            joints.append(
                {
                    "name": joint.name,
                    "type": str(joint.type),
                    "parent": joint.parent,
                    "child": joint.child,
                    "origin": _numbers(joint.origin),
                    "axis": list(joint.axis),
                    "leader": self._names.index(leader.joint) if joint.moves else -1,
                    "ratio": leader.multiplier,
                    "offset": leader.offset,
                    "limits": [max(ends.lower, -math.pi), min(ends.upper, math.pi)],
                }
            )
        shapes = _Shapes(model.urdf, meshes_at)
        self.meshes = tuple(shapes.meshes)
        self.about: dict[str, Any] = {
            "name": model.name,
            "root": model.root,
            "independent": list(self._names),
            "joints": joints,
            "shapes": shapes.found,
            "notices": list(dict.fromkeys(shapes.notices)),
        }
        if head is not None:
            at_zero = dict.fromkeys(self._names, 0.0)
            self._T_base_root = model.transform(model.root, head.base_frame, at_zero).inverse()
            self.about |= {
                "pan": head.pan_joint,
                "tilt": head.tilt_joint,
                "camera": head.pointing_frame,
                "axis": list(head.pointing_axis),
            }

    def state(self, live: Observation) -> dict[str, Any]:
        """Return joints, target and wanted joint positions for JSON [rad, m, s]."""
        return {
            "stamp": live.stamp * 1e-9,
            "target_stamp": number(None if live.target_stamp is None else live.target_stamp * 1e-9),
            "joints": [number(live.joints.get(name)) for name in self._names],
            "target": None if live.target is None else list(map(number, live.target)),
            "wanted": list(map(number, self._wanted_gaze(live))),
        }

    def _wanted_gaze(self, live: Observation) -> tuple[float | None, float | None]:
        """Return pan and tilt that look at the target or nearest to it; None without one."""
        head = self._head
        if head is None or live.target is None:
            return None, None
        positions = (live.joints.get(joint, 0.0) for joint in (head.pan_joint, head.tilt_joint))
        gaze = head.gaze(self._T_base_root @ live.target, *positions)
        return gaze.pan, gaze.tilt


def number(value: float | None) -> float | None:
    """Return a number for JSON; None for None and for numbers that are not finite."""
    return None if value is None or not math.isfinite(value) else round(float(value), 6)


class _Shapes:
    """The shapes of a model's links for JSON, their meshes, and what can't be shown."""

    def __init__(self, urdf: str, meshes_at: str) -> None:
        # yourdfpy logs what it does not understand; that becomes a notice here
        logging.getLogger("yourdfpy").setLevel(logging.ERROR)
        yourdfpy = import_yourdfpy()
        robot = yourdfpy.URDF.load(
            io.BytesIO(urdf.encode()), build_scene_graph=False, load_meshes=False
        ).robot
        self.found: list[dict[str, Any]] = []
        self.meshes: list[bytes] = []
        self.notices: list[str] = []
        self._meshes_at = meshes_at
        self._materials = {material.name: material for material in robot.materials}
        self._loaded = cache(_load)
        for link in robot.links:
            for visual in link.visuals:
                try:
                    self._add(link.name, visual)
                except (TypeError, ValueError) as error:
                    self.notices.append(f"{link.name}: a shape is left out: {error}")

    def _add(self, link: str, visual: Any) -> None:
        origin = visual.origin
        transform = Transform.identity() if origin is None else Transform.from_matrix(origin)
        shape: dict[str, Any] = {"link": link, "place": _numbers(transform)}
        shape["rgba"] = self._colour(visual.material)
        geometry = visual.geometry
        if geometry is not None and geometry.box is not None:
            x, y, z = map(float, geometry.box.size)
            shape |= {"kind": "box", "size": [x, y, z]}
        elif geometry is not None and geometry.cylinder is not None:
            size = [float(geometry.cylinder.radius), float(geometry.cylinder.length)]
            shape |= {"kind": "cylinder", "size": size}
        elif geometry is not None and geometry.sphere is not None:
            shape |= {"kind": "sphere", "size": [float(geometry.sphere.radius)]}
        elif geometry is not None and geometry.mesh is not None:
            shape |= self._mesh(geometry.mesh)
        else:
            raise ValueError("its kind is not supported")
        if not all(
            abs(n) < _LARGEST for n in (*shape["place"], *shape.get("size", ()), *shape["rgba"])
        ):
            raise ValueError("a number of it is too large or not finite")
        self.found.append(shape)

    def _mesh(self, geometry: Any) -> dict[str, Any]:
        mesh = self._loaded(geometry.filename).copy()
        scale = 1.0 if geometry.scale is None else geometry.scale
        if not (np.abs(mesh.bounds * scale) < _LARGEST).all():
            raise ValueError(f"the mesh {geometry.filename!r} is too large or not finite")
        mesh.apply_scale(scale)
        is_coloured = mesh.visual.kind == "texture" or bool(mesh.visual.defined)
        self.meshes.append(bytes(mesh.export(file_type="glb" if is_coloured else "stl")))
        address = f"{self._meshes_at}{len(self.meshes) - 1}"
        return {"kind": "coloured" if is_coloured else "mesh", "mesh": address}

    def _colour(self, material: Any) -> list[float]:
        if material is not None and material.color is None:
            material = self._materials.get(material.name)
        if material is None or material.color is None:
            return _GREY
        r, g, b, a = (min(max(float(value), 0.0), 1.0) for value in material.color.rgba)
        return [r, g, b, a]


def _load(address: str) -> Any:
    """Return the mesh at an address; raise ValueError if it can't be shown."""
    import trimesh  # takes a second, and not every robot has meshes

    file = mesh_file(address)
    try:
        mesh = trimesh.load(file, force="mesh")
        if not len(mesh.faces):
            raise ValueError("it has no triangles")
    except Exception as error:  # readers of mesh files raise any error
        raise ValueError(
            f"the mesh {address!r} can't be read ({error or type(error).__name__}); "
            ".dae files need pycollada (pip install pycollada)"
        ) from error
    return mesh


def mesh_file(address: str) -> Path:
    """Return the file of a URDF mesh by its `filename`.

    Raises:
        ValueError: there is none; with what to do.
    """
    kind, separator, rest = address.partition("://")
    path: Path | None = Path(unquote(rest) if kind == "file" else address)
    if kind == "package" and separator:
        package, _, inside = unquote(rest).partition("/")
        folder = find_package(package)
        path = None if folder is None else folder / inside
    if path is None or not path.is_absolute() or not path.is_file():
        raise ValueError(
            f"there is no file for the mesh {address!r}: write package://<package>/<path> or "
            "file:///<path>, install or source the package, and start the viewer again"
        )
    return path


def _numbers(transform: Transform) -> Sequence[float]:
    return [*map(float, transform.translation), *map(float, transform.rotation)]


def find_package(name: str) -> Path | None:
    """Return the shared files of a ROS package; None if it is not installed."""
    if name == PACKAGE:
        return share_directory()
    try:
        return Path(get_package_share_directory(name))
    except (LookupError, OSError, ValueError):  # not installed; no index; an invalid name
        return None
