"""check_model: prints the tree of a robot model, or the error in it."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from head_tracking.command_line import DONE, exit_code
from head_tracking.share import robot_file
from head_tracking.transforms import load_robot_model
from head_tracking.transforms.robot_model import walk


def main(arguments: Sequence[str] | None = None) -> int:
    """Check the model named on the command line; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="check_model", description="Checks a robot model and prints its tree."
    )
    parser.add_argument("model", help="a URDF or xacro file, or the name of a robot")
    name = parser.parse_args(arguments).model
    return exit_code("check_model", lambda: _check(name))


def _check(name: str) -> int:
    """Print the tree in the format of urdf's check_urdf, and the number of links and joints."""
    model = load_robot_model(robot_file(name))
    print(f"robot name is: {model.name}\n---------- Successfully Parsed XML ---------------")
    for entry in walk(model):
        if entry.depth == 0:
            print(f"root Link: {entry.link} has {entry.children} child(ren)")
        else:
            print(f"{'    ' * entry.depth}child({entry.rank}):  {entry.link}")
    moving = [joint for joint in model.joints.values() if joint.moves]
    mimics = sum(joint.mimic is not None for joint in moving)
    print(
        f"{len(model.links)} links, {len(model.joints)} joints: {len(moving)} move, "
        f"{mimics} of them mimic another"
    )
    return DONE
