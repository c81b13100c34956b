"""Run a command of a document: `head_tracking ...` or `ros2 ...`.

The ROS wheels have no ros2cli: of `ros2 topic`, `ros2 service` and `ros2 param` this checks that
the name is in docs/reference, and that the message fits its type.
"""

import re
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import yaml

from head_tracking import programs

REFERENCE = Path(__file__).parents[2] / "docs" / "reference"
NAMES = re.compile(r"`([^`\s]+)`")


def known(name: str) -> bool:
    """Return whether a document of the reference names a topic, a service or a node."""
    text = "".join((REFERENCE / f"{page}.md").read_text() for page in ("topics", "nodes"))
    name = re.sub(r"^\w+_controller/", "<controller>/", name.removeprefix("/"))
    node = name.partition("/")[0]
    private = f"~/{name.removeprefix(f'{node}/')}"
    return bool({name, f"/{name}", private} & {*NAMES.findall(text)}) or f"## {node}\n" in text


def fill(message: Any, values: dict[str, Any]) -> None:
    """Set the fields of a message; it raises what a wrong name or type deserves."""
    for name, value in values.items():
        if isinstance(value, dict):
            fill(getattr(message, name), value)
        else:
            setattr(message, name, value)


def check(words: list[str]) -> None:
    """Check a command that asks ROS 2 itself."""
    name, *rest = [word for word in words[2:] if not word.startswith("-")]
    assert known(name), f"no node has {name}"
    if words[:2] in (["topic", "pub"], ["service", "call"]):
        package, _, kind = rest[0].split("/")
        found = getattr(import_module(f"{package}.{'msg' if words[0] == 'topic' else 'srv'}"), kind)
        message = found() if words[0] == "topic" else found.Request()
        fill(message, yaml.safe_load(rest[1]) if len(rest) > 1 else {})


def main() -> int:
    """Run the command in `sys.argv`."""
    program, *words = sys.argv[1:]
    if program == "ros2":
        if words[:2] != ["run", "head_tracking"]:
            check(words)
            return 0
        words = words[2:]
        if words[0] == "head_tracking":
            words = words[1:]
    sys.argv = ["head_tracking", *words]
    code: int = programs.head_tracking()
    return code


if __name__ == "__main__":
    raise SystemExit(main())
