"""Robot models from URDF and xacro files, parsed in this process or in a short-lived one."""

from __future__ import annotations

import importlib
import os
import pickle
import signal
import subprocess
import sys
import threading
from functools import cache
from html import escape
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from head_tracking.transforms.exceptions import RobotModelError
from head_tracking.transforms.robot_model import Joint, JointType, RobotModel
from head_tracking.transforms.transform import Transform

_parses_in_child = False
_xacro_lock = threading.Lock()  # xacro keeps its state in its module


def parse_in_child_process() -> None:
    """Parse all models from now on in a short-lived child process.

    The parser's libraries (yourdfpy, lxml, xacro) take 12 MB, which a process never gives back.
    A child process costs 0.3 s of processor time for each model.
    """
    global _parses_in_child  # noqa: PLW0603 one setting per process
    _parses_in_child = True


@cache
def import_yourdfpy() -> ModuleType:
    """Import yourdfpy with a stand-in for trimesh, which loads trimesh when it is first used.

    Few robots need meshes, and trimesh with its scipy takes 1 s of processor time and 60 MB.
    """
    spec = find_spec("trimesh")
    if spec is None or "trimesh" in sys.modules:
        return importlib.import_module("yourdfpy")
    stand_in = ModuleType("trimesh")
    stand_in.__path__ = list(spec.submodule_search_locations or ())
    named = {"Trimesh": object, "Scene": object}  # in annotations
    vars(stand_in).update(
        named, __getattr__=lambda name: getattr(importlib.import_module("trimesh"), name)
    )
    sys.modules["trimesh"] = stand_in
    try:
        return importlib.import_module("yourdfpy")
    finally:
        for name in [name for name in sys.modules if name.partition(".")[0] == "trimesh"]:
            del sys.modules[name]
        for name in named:
            delattr(stand_in, name)


def load_robot_model(path: str | Path) -> RobotModel:
    """Return the model in a URDF file, or in a xacro file if its name ends in .xacro.

    Raises:
        RobotModelError: the file cannot be read, or the model is not valid.
    """
    return _parse("load_robot_model", Path(path).absolute())


def parse_robot_model(urdf: str) -> RobotModel:
    """Return the model in the text of a URDF document.

    A base on a floating or planar joint is the root of the model: where it stands, others know.

    Raises:
        RobotModelError: the model is not valid; names the link or joint.
    """
    return _parse("parse_robot_model", urdf)


def with_fixed_root(model: RobotModel, frame: str, T_frame_root: Transform) -> RobotModel:
    """Return the model with one more link above its root, for example `world`.

    Args:
        model: the model.
        frame: the new root link.
        T_frame_root: takes points from the old root into `frame`.

    Raises:
        RobotModelError: the model has a link of this name.
    """
    name = f"{frame}_{model.root}_joint"
    xyz, rpy = T_frame_root.translation, T_frame_root.rotation.as_rpy()
    # without an XML parser: it would take memory of the control process
    before, end, after = model.urdf.rpartition("</")  # of the root
    added = (
        f'<joint name="{escape(name)}" type="fixed"><parent link="{escape(frame)}"/>'
        f'<child link="{escape(model.root)}"/>'
        f'<origin xyz="{" ".join(map(repr, xyz))}" rpy="{" ".join(map(repr, rpy))}"/></joint>'
        f'<link name="{escape(frame)}"/>'
    )
    return RobotModel(
        model.name,
        [*model.links, frame],
        [*model.joints.values(), Joint(name, JointType.FIXED, frame, model.root, T_frame_root)],
        before + added + end + after,
    )


def _parse(function: str, *arguments: Any) -> RobotModel:
    """Call a function of `urdf_parser`."""
    if find_spec("yourdfpy") is None:  # the only requirement that ROS does not install
        raise RobotModelError(
            "yourdfpy, which reads robot models, is not installed. In a colcon workspace: "
            "ros2 run head_tracking head_setup yourdfpy; elsewhere: pip install yourdfpy"
        )
    if not _parses_in_child:
        from head_tracking.transforms import urdf_parser

        with _xacro_lock:
            model: RobotModel = getattr(urdf_parser, function)(*arguments)
        return model
    # Ctrl-C is for this process; the child would get it until its own session begins
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        child = subprocess.Popen(
            [sys.executable, "-m", "head_tracking.transforms.urdf_parser"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
            start_new_session=True,
        )
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    with child:
        output, _ = child.communicate(pickle.dumps((function, arguments)))
    if child.returncode != 0:
        raise RobotModelError(f"the process that parses URDF ended with code {child.returncode}")
    result = pickle.loads(output)
    if isinstance(result, RobotModelError):
        raise result
    parsed: RobotModel = result
    return parsed
