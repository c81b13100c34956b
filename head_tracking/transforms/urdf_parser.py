"""Parser of URDF and xacro, with yourdfpy.

`python -m head_tracking.transforms.urdf_parser` reads a pickled call from standard input and
writes the pickled model, or the error, to standard output; see `urdf.parse_in_child_process`.
"""

from __future__ import annotations

import io
import math
import os
import pickle
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np
import xacro

from head_tracking.transforms.exceptions import RobotModelError
from head_tracking.transforms.robot_model import Joint, JointLimits, JointType, Mimic, RobotModel
from head_tracking.transforms.transform import Transform, Vector3
from head_tracking.transforms.urdf import import_yourdfpy

if TYPE_CHECKING:
    import yourdfpy
else:
    yourdfpy = import_yourdfpy()

_FREE = ("floating", "planar")  # joints of a base that drives or walks; /tf tells where it is

# element, attribute: how many numbers it holds
_NUMBERS = {
    ("origin", "xyz"): 3,
    ("origin", "rpy"): 3,
    ("axis", "xyz"): 3,
    ("limit", "lower"): 1,
    ("limit", "upper"): 1,
    ("limit", "velocity"): 1,
    ("limit", "effort"): 1,
    ("mimic", "multiplier"): 1,
    ("mimic", "offset"): 1,
}


def load_robot_model(path: Path) -> RobotModel:
    """See `urdf.load_robot_model`."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RobotModelError(f"cannot read the robot model {path}: {error}") from error
    try:
        if path.suffix == ".xacro":
            text = _expand(path)
        return parse_robot_model(text)
    except RobotModelError as error:
        raise RobotModelError(f"{path}: {error}") from error


def parse_robot_model(urdf: str) -> RobotModel:
    """See `urdf.parse_robot_model`."""
    _check_document(urdf)
    try:
        robot = yourdfpy.URDF.load(
            io.BytesIO(urdf.encode()), build_scene_graph=False, load_meshes=False
        ).robot
    except Exception as error:  # yourdfpy lets all errors of invalid shapes and materials pass
        raise RobotModelError(f"yourdfpy cannot read the model: {error!r}") from error
    joints = [_joint(joint) for joint in robot.joints if joint.type not in _FREE]
    connected = {link for joint in joints for link in (joint.parent, joint.child)}
    outside = {joint.parent for joint in robot.joints if joint.type in _FREE} - connected
    links = [link.name for link in robot.links if link.name not in outside]
    return RobotModel(robot.name, links, joints, urdf)


def _expand(path: Path) -> str:
    try:
        return str(xacro.process_file(str(path)).toxml())
    except Exception as error:  # xacro's own, expat's, and those of evaluated expressions
        raise RobotModelError(f"xacro cannot expand the model: {error}") from error


def _check_document(urdf: str) -> None:
    """Raise for what yourdfpy accepts silently, or refuses with an error of Python."""
    try:
        document = ElementTree.fromstring(urdf)
    except ElementTree.ParseError as error:
        raise RobotModelError(f"the model is not well-formed XML: {error}") from error
    if document.tag != "robot":
        raise RobotModelError(f"the document is a <{document.tag}>; a URDF model is a <robot>")
    _require(document, "the <robot>", "name")
    for number, link in enumerate(document.findall("link"), start=1):
        _require(link, f"<link> number {number}", "name")
    for number, joint in enumerate(document.findall("joint"), start=1):
        name = f"joint {_require(joint, f'<joint> number {number}', 'name')!r}"
        kind = _require(joint, name, "type")
        allowed = (*JointType, *_FREE)
        if kind not in allowed:
            raise RobotModelError(f"{name} has the type {kind!r}; allowed are {', '.join(allowed)}")
        for role in ("parent", "child"):
            element = joint.find(role)
            if element is None:
                raise RobotModelError(f"{name} has no <{role}>; name the link it connects")
            _require(element, f"the <{role}> of {name}", "link")
        mimic = joint.find("mimic")
        if mimic is not None:
            _require(mimic, f"the <mimic> of {name}", "joint")
        for (tag, attribute), count in _NUMBERS.items():
            element = joint.find(tag)
            if element is not None and attribute in element.attrib:
                _check_numbers(f"{name}: <{tag} {attribute}>", element.attrib[attribute], count)


def _require(element: ElementTree.Element, what: str, attribute: str) -> str:
    value = element.get(attribute)
    if not value:
        raise RobotModelError(f"{what} has no attribute {attribute!r}; add it")
    return value


def _check_numbers(what: str, text: str, count: int) -> None:
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        wanted = "a finite number" if count == 1 else f"{count} finite numbers"
        raise RobotModelError(f"{what} is {text!r}; it needs {wanted}")


def _joint(joint: yourdfpy.Joint) -> Joint:
    kind = JointType(joint.type)
    mimic = joint.mimic and Mimic(joint.mimic.joint, joint.mimic.multiplier, joint.mimic.offset)
    return Joint(
        name=joint.name,
        type=kind,
        parent=joint.parent,
        child=joint.child,
        origin=Transform.identity()
        if joint.origin is None
        else Transform.from_matrix(joint.origin),
        axis=(1.0, 0.0, 0.0) if kind is JointType.FIXED else _axis(joint),
        limits=_limits(joint, kind),
        mimic=None if kind is JointType.FIXED else mimic,
    )


def _axis(joint: yourdfpy.Joint) -> Vector3:
    axis = np.array([1.0, 0.0, 0.0]) if joint.axis is None else joint.axis
    norm = float(np.linalg.norm(axis))
    if norm < 1e-9:
        raise RobotModelError(f"joint {joint.name!r} has a zero <axis>; give it a direction")
    x, y, z = (axis / norm).tolist()
    return x, y, z


def _limits(joint: yourdfpy.Joint, kind: JointType) -> JointLimits:
    limit = joint.limit
    bounded = kind in (JointType.REVOLUTE, JointType.PRISMATIC)
    if limit is None:
        if bounded:
            raise RobotModelError(
                f"joint {joint.name!r} is {kind} and has no <limit>; give it lower and upper"
            )
        return JointLimits()
    # URDF: lower and upper are 0 where they are left out
    lower = (limit.lower or 0.0) if bounded else -math.inf
    upper = (limit.upper or 0.0) if bounded else math.inf
    if bounded and lower > upper and joint.mimic is None:
        raise RobotModelError(
            f"joint {joint.name!r} has the limits {lower} to {upper}; upper must not be below lower"
        )
    if limit.velocity is not None and limit.velocity < 0.0:
        raise RobotModelError(
            f"joint {joint.name!r} has the velocity limit {limit.velocity}; it must be above 0, or "
            "0 for no limit"
        )
    # exporters write 0 for what they do not know
    return JointLimits(lower, upper, limit.velocity or math.inf)


def _serve() -> None:
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # the program that asked has been killed
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as output:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what libraries print
        call = sys.stdin.buffer.read()
        if not call:
            return
        function, arguments = pickle.loads(call)
        try:
            result = globals()[function](*arguments)
        except RobotModelError as error:
            result = error
        pickle.dump(result, output)


if __name__ == "__main__":
    _serve()
