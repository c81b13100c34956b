"""Run a command of a document: `head_tracking ...` or `ros2 ...`.

What has no end is ended by Ctrl-C when its nodes have started.

The ROS wheels have no ros2cli: of `ros2 topic`, `ros2 service` and `ros2 param` this checks that
the name is in docs/reference, and that the message fits its type.
"""

import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import yaml

from head_tracking import programs
from head_tracking.ros.kit.stop_signal import StopSignal
from head_tracking.run.node_sets import PAGE
from head_tracking.run.supervisor import Supervisor

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


def nodes_run(supervisor: Supervisor) -> bool:
    """Return whether all nodes of a run have started, in all of its processes."""
    pages = supervisor._others[PAGE].nodes.values()
    return supervisor._is_ready and all("port" in page["parameters"] for page in pages)


def interrupt_after(owner: Any, name: str, runs: Callable[[Any], bool]) -> None:
    """Interrupt this program soon after it has called a method of an object that `runs`."""
    method = getattr(owner, name)
    timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))

    def called(self: Any, *given: Any) -> Any:
        if runs(self) and timer.ident is None:
            timer.start()
        return method(self, *given)

    setattr(owner, name, called)


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
    if words[0].startswith("-"):
        interrupt_after(Supervisor, "_update", nodes_run)
    elif words[0] in programs.NODES:
        interrupt_after(StopSignal, "wait", lambda _: True)
    elif words[0] == "transforms":
        interrupt_after(time, "sleep", lambda _: True)
    elif words[0] == "calibrate":  # in 10 s, not 30
        gathering = import_module("head_tracking.calibration.gathering")
        vars(gathering).update(MOST_VIEWS=13, _SETTLING=0.15, _SPEED=2.0)
    sys.argv = ["head_tracking", *words]
    code: int = programs.head_tracking()
    return code


if __name__ == "__main__":
    raise SystemExit(main())
