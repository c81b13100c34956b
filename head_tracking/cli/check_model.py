"""check_model: prints the tree of a robot model, or the error in it."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from head_tracking.command_line import exit_code
from head_tracking.share import robot_file
from head_tracking.transforms import load_robot_model


def main(arguments: Sequence[str] | None = None) -> int:
    """Check the model named on the command line; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="check_model", description="Checks a robot model and prints its tree."
    )
    parser.add_argument("model", help="a URDF or xacro file, or the name of a robot")
    name = parser.parse_args(arguments).model
    return exit_code("check_model", lambda: _check(name))


def _check(name: str) -> None:
    """Print the tree in the format of urdf's check_urdf, and the number of links and joints."""
    model = load_robot_model(robot_file(name))
    print(f"robot name is: {model.name}\n---------- Successfully Parsed XML ---------------")
    children: dict[str, list[str]] = {link: [] for link in model.links}
    for joint in model.joints.values():
        children[joint.parent].append(joint.child)
    print(f"root Link: {model.root} has {len(children[model.root])} child(ren)")
    lines = [("", model.root)]
    while lines:
        line, link = lines.pop()
        if line:
            print(f"{line}{link}")
        indent = " " * (len(line) - len(line.lstrip()) + 4)
        below = enumerate(children[link], start=1)
        lines += reversed([(f"{indent}child({rank}):  ", child) for rank, child in below])
    moving = [joint for joint in model.joints.values() if joint.moves]
    mimics = sum(joint.mimic is not None for joint in moving)
    print(
        f"{len(model.links)} links, {len(model.joints)} joints: {len(moving)} move, "
        f"{mimics} of them mimic another"
    )
