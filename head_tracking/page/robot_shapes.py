"""A robot as the browser draws it: its tree of joints, and the shapes of its links."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from head_tracking.gaze import PanTiltHead
from head_tracking.page.gaze_lines import reachable_field
from head_tracking.page.shapes import Box, Cylinder, Look, Mesh, Missing, Sphere
from head_tracking.transforms import RobotModel, Transform

_MISSING_SIZE = 0.05  # m


class RobotForBrowser(NamedTuple):
    """A robot as the browser draws it.

    Attributes:
        about: its joints, shapes and head, for JSON.
        meshes: binary STL; of kind `coloured`: binary glTF.
    """

    about: dict[str, Any]
    meshes: tuple[bytes, ...]


def described(
    model: RobotModel, look: Look, head: PanTiltHead | None, radius: float, meshes_at: str
) -> RobotForBrowser:
    """Return a robot for the browser.

    Transforms are [x, y, z, qx, qy, qz, qw] in metres. Joints stand in the order of
    `model.joints`; `leader` is the index of the joint position in `independent` that moves a
    joint, which then stands at `ratio` times that plus `offset`.

    Args:
        model: the robot.
        look: its shapes.
        head: its head; None: it has none.
        radius: of the reachable field [m].
        meshes_at: the address of the meshes, up to their number.
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
                "limits": finite(joint.limits),
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
            case Mesh(mesh, coloured):
                kind = "coloured" if coloured else "mesh"
                about |= {"kind": kind, "mesh": f"{meshes_at}{len(meshes)}"}
                meshes.append(bytes(mesh.export(file_type="glb" if coloured else "stl")))
            case Missing():
                about |= {"kind": "box", "size": [_MISSING_SIZE] * 3, "rgba": [0.9, 0.25, 0.25, 1]}
        shapes.append(about)
    robot: dict[str, Any] = {
        "name": model.name,
        "root": model.root,
        "independent": independent,
        "joints": joints,
        "shapes": shapes,
        "notices": list(look.notices),
    }
    if head is not None:
        robot |= {
            "pan": head.pan_joint,
            "tilt": head.tilt_joint,
            "camera": head.pointing_frame,
            "axis": list(head.pointing_axis),
            "pan_limits": finite(head.pan_limits),
            "tilt_limits": finite(head.tilt_limits),
            "field": reachable_field(model, head, radius).round(4).reshape(-1).tolist(),
        }
    return RobotForBrowser(robot, tuple(meshes))


def finite(limits: Any) -> list[float]:
    """Return the lower and upper limit of a joint, at most half a turn each way."""
    if limits is None:
        return [-math.pi, math.pi]
    return [max(limits.lower, -math.pi), min(limits.upper, math.pi)]


def numbers(transform: Transform) -> Sequence[float]:
    """Return a transform as [x, y, z, qx, qy, qz, qw]."""
    return [*map(float, transform.translation), *map(float, transform.rotation)]
