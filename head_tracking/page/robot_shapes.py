"""A robot as the browser draws it: its tree of joints, and the shapes of its links."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from head_tracking.transforms import RobotModel, Transform
from head_tracking.viewer.shapes import Box, Cylinder, Look, Mesh, Missing, Sphere

_MISSING_SIZE = 0.05  # m


def described(model: RobotModel, look: Look) -> tuple[dict[str, Any], tuple[bytes, ...]]:
    """Return a robot for the browser, and its meshes as binary STL.

    Transforms are [x, y, z, qx, qy, qz, qw] in metres. Joints stand in the order of
    `model.joints`; `leader` is the index of the joint position in `independent` that moves a
    joint, which then stands at `ratio` times that plus `offset`.
    """
    independent = list(model.independent_joints)
    joints = []
    for joint in model.joints.values():
        leader = model.leader(joint.name)
        joints.append(
            {
                "name": joint.name,
                "type": str(joint.type),
                "parent": joint.parent,
                "child": joint.child,
                "origin": numbers(joint.origin),
                "axis": list(joint.axis),
                "leader": independent.index(leader.joint) if joint.moves else -1,
                "ratio": leader.multiplier,
                "offset": leader.offset,
            }
        )
    meshes: list[bytes] = []
    shapes = []
    for shape in look.shapes:
        about: dict[str, Any] = {
            "link": shape.link,
            "place": numbers(shape.T_link_shape),
            "rgba": list(shape.rgba),
        }
        match shape.geometry:
            case Box(size):
                about |= {"kind": "box", "size": list(size)}
            case Cylinder(radius, length):
                about |= {"kind": "cylinder", "size": [radius, length]}
            case Sphere(radius):
                about |= {"kind": "sphere", "size": [radius]}
            case Mesh(mesh):
                about |= {"kind": "mesh", "mesh": len(meshes)}
                meshes.append(bytes(mesh.export(file_type="stl")))
            case Missing():
                about |= {"kind": "box", "size": [_MISSING_SIZE] * 3, "rgba": [0.9, 0.25, 0.25, 1]}
        shapes.append(about)
    robot = {
        "name": model.name,
        "root": model.root,
        "independent": independent,
        "joints": joints,
        "shapes": shapes,
        "notices": list(look.notices),
    }
    return robot, tuple(meshes)


def numbers(transform: Transform) -> Sequence[float]:
    """Return a transform as [x, y, z, qx, qy, qz, qw]."""
    return [*map(float, transform.translation), *map(float, transform.rotation)]
