"""What the links of a URDF model look like, and what of it can't be shown."""

from __future__ import annotations

import io
import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

import yourdfpy

from head_tracking.transforms import Transform, Vector3

if TYPE_CHECKING:
    import trimesh

_GREY = (0.6, 0.6, 0.62, 1.0)

FindPackage = Callable[[str], Path | None]
"""Where a ROS package keeps its shared files; None if it is not installed."""


@dataclass(frozen=True, slots=True)
class Box:
    """A box of this size in x, y and z [m]."""

    size: Vector3


@dataclass(frozen=True, slots=True)
class Cylinder:
    """A cylinder along z [m]."""

    radius: float
    length: float


@dataclass(frozen=True, slots=True)
class Sphere:
    """A sphere [m]."""

    radius: float


@dataclass(frozen=True, slots=True)
class Mesh:
    """Triangles.

    Attributes:
        mesh: vertices [m], faces and colours.
        coloured: it has colours of its own.
    """

    mesh: trimesh.Trimesh
    coloured: bool


@dataclass(frozen=True, slots=True)
class Missing:
    """Stands where a mesh should be that can't be shown."""

    filename: str


@dataclass(frozen=True, slots=True)
class Shape:
    """One visual of a link.

    Attributes:
        link: the link.
        T_link_shape: takes points of the shape into the link.
        geometry: what it is.
        rgba: its colour, each 0 to 1.
    """

    link: str
    T_link_shape: Transform
    geometry: Box | Cylinder | Sphere | Mesh | Missing
    rgba: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Look:
    """All shapes of a robot, and a sentence on each that can't be shown."""

    shapes: tuple[Shape, ...]
    notices: tuple[str, ...]


def robot_look(urdf: str, find_package: FindPackage = lambda _: None) -> Look:
    """What a model looks like. Shapes that are missing or broken are told of, never raised.

    Args:
        urdf: the model's text.
        find_package: for addresses that start with package://.
    """
    # a shape that yourdfpy does not understand is told of below, not on the terminal
    logging.getLogger("yourdfpy").setLevel(logging.ERROR)
    robot = yourdfpy.URDF.load(
        io.BytesIO(urdf.encode()), build_scene_graph=False, load_meshes=False
    ).robot
    palette = {material.name: material for material in robot.materials}
    shapes: list[Shape] = []
    notices: list[str] = []
    loaded: dict[str, trimesh.Trimesh | str] = {}
    for link in robot.links:
        for visual in link.visuals:
            try:
                shape = _shape(link.name, visual, palette, partial(_load, find_package, loaded))
            except (TypeError, ValueError) as error:  # its size, its place or its colour
                notices.append(f"{link.name} has a shape that can't be read; left out: {error}")
                continue
            if shape is None:
                notices.append(f"{link.name} has a shape of a kind that is not known; left out")
                continue
            if isinstance(shape.geometry, Missing):
                notices.append(f"{link.name}: {loaded[shape.geometry.filename]}")
            shapes.append(shape)
    return Look(tuple(shapes), tuple(dict.fromkeys(notices)))


def mesh_file(address: str, find_package: FindPackage) -> Path:
    """The file that the `filename` of a URDF mesh means.

    Raises:
        ValueError: it can't be found; says why and what to do.
    """
    kind, separator, rest = address.partition("://")
    if not separator:
        path = Path(address)
        if not path.is_absolute():
            raise ValueError(
                f"the mesh {address!r} is given relative to a file that is not known here; write "
                "package://<package>/<path> or file:///<path>"
            )
    elif kind == "package":
        package, _, inside = unquote(rest).partition("/")
        folder = find_package(package)
        if folder is None:
            raise ValueError(
                f"the mesh {address!r} is in the package {package!r}, which is not installed here; "
                "install or source it and start the viewer again"
            )
        path = folder / inside
    elif kind == "file":
        path = Path(unquote(rest))
    else:
        raise ValueError(f"the mesh {address!r} is at an address of a kind that is not loaded")
    if not path.is_file():
        raise ValueError(f"the mesh {address!r} is not there: no file {path}")
    return path


def _shape(
    link: str, visual: Any, palette: dict[str, Any], load: Callable[[str], trimesh.Trimesh | None]
) -> Shape | None:
    """Return a visual of a link as a shape; None for a kind that is not known."""
    geometry = _geometry(visual.geometry, load)
    if geometry is None:
        return None
    place = Transform.identity() if visual.origin is None else Transform.from_matrix(visual.origin)
    return Shape(link, place, geometry, _rgba(visual.material, palette))


def _geometry(
    geometry: Any, load: Callable[[str], trimesh.Trimesh | None]
) -> Box | Cylinder | Sphere | Mesh | Missing | None:
    if geometry is None:
        return None
    if geometry.box is not None:
        x, y, z = map(float, geometry.box.size)
        return Box((x, y, z))
    if geometry.cylinder is not None:
        return Cylinder(float(geometry.cylinder.radius), float(geometry.cylinder.length))
    if geometry.sphere is not None:
        return Sphere(float(geometry.sphere.radius))
    if geometry.mesh is None:
        return None
    mesh = load(geometry.mesh.filename)
    if mesh is None:
        return Missing(geometry.mesh.filename)
    if geometry.mesh.scale is not None:
        mesh = mesh.copy()
        mesh.apply_scale(geometry.mesh.scale)
    coloured = mesh.visual.kind == "texture" or bool(mesh.visual.defined)
    return Mesh(mesh, coloured)


def _load(
    find_package: FindPackage, loaded: dict[str, trimesh.Trimesh | str], address: str
) -> trimesh.Trimesh | None:
    """The mesh at an address; None with the reason in `loaded`."""
    if address not in loaded:
        import trimesh  # takes half a second; a robot of boxes and cylinders does without

        try:
            mesh = trimesh.load(mesh_file(address, find_package), force="mesh")
            loaded[address] = (
                mesh if len(mesh.faces) else f"the mesh {address!r} has no triangles in it"
            )
        except ValueError as error:
            loaded[address] = str(error)
        except Exception as error:
            # readers of mesh files raise whatever they stumble over
            loaded[address] = (
                f"the mesh {address!r} can't be read ({error or type(error).__name__}); .dae files "
                "need pycollada (pip install pycollada)"
            )
    found = loaded[address]
    return None if isinstance(found, str) else found


def _rgba(material: Any, palette: dict[str, Any]) -> tuple[float, float, float, float]:
    if material is not None and material.color is None:
        material = palette.get(material.name)
    if material is None or material.color is None:
        return _GREY
    r, g, b, a = (min(max(float(value), 0.0), 1.0) for value in material.color.rgba)
    return r, g, b, a
