"""Write docs/reference/ and the tree in docs/explain/architecture.md from the code.

Every node is started once, without other nodes; its topics, services, actions and parameters are
read from the running node. Only the table of meanings is written by hand.
"""

import ast
import io
import os
import re
import sys
import tempfile
from collections import defaultdict
from contextlib import ExitStack, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from pkgutil import resolve_name
from typing import Any
from unittest import mock

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "head_tracking"
REFERENCE = ROOT / "docs" / "reference"
ARCHITECTURE = ROOT / "docs" / "explain" / "architecture.md"
MEANINGS = Path(__file__).with_suffix(".toml")
SOURCE_NOTE = "<!-- Written by scripts/reference from the code. Do not edit. -->\n"
TREE_MARKS = ("<!-- tree: begin -->", "<!-- tree: end -->")
EXAMPLE_CONTROLLERS = re.compile(r"\bhead_(pan|tilt)_controller\b")
ROS_NAMES = re.compile(
    r"^/(rosout|parameter_events|clock)$|_parameter|get_type_desc|/qos_|_action/"
)
ROS_PARAMETERS = re.compile(r"^(use_sim_time|start_type_description_service|qos_overrides\..*)$")
GOAL = "/_action/send_goal"
ABSOLUTE = ("/tf", "/tf_static", "/diagnostics")
NEEDED = {"frame_target": {"frame": "camera_link"}, "viewer": {"port": 0}}
"""Parameters that a node needs to start in this script."""


@dataclass
class Interface:
    """Topics, services, actions and parameters of a running node."""

    name: str  # of the node
    summary: str  # first sentence of its class
    # direction ("publishes", "subscribes to", "services", "actions") -> name -> type
    topics: dict[str, dict[str, str]] = field(default_factory=lambda: defaultdict(dict))
    parameters: list[tuple[str, ...]] = field(default_factory=list)  # rows of the parameter table

    def add(self, direction: str, found: list[tuple[str, list[str]]]) -> None:
        """Add names with their types; an action is recognised by its service to send goals."""
        for topic, (kind, *_) in found:
            if topic.endswith(GOAL):
                name = shown(topic.removesuffix(GOAL), self.name)
                self.topics["actions"][name] = kind.removesuffix("_SendGoal")
            elif not ROS_NAMES.search(topic):
                self.topics[direction][shown(topic, self.name)] = kind


def first_line(path: Path) -> str:
    """Return the first line of the docstring of a Python file, or the comment of JavaScript."""
    if path.suffix == ".js":
        return path.read_text().partition("\n")[0].removeprefix("// ")
    return (ast.get_docstring(ast.parse(path.read_text())) or "").partition("\n")[0]


def draw_tree() -> str:
    """Return the tree of the package with the first line of each file."""
    lines = ["head_tracking/"]
    files = (path for path in PACKAGE.rglob("*.*") if path.suffix in (".py", ".js"))
    for path in sorted(files, key=lambda path: (path.parent.parts, path.name)):
        parts = path.relative_to(PACKAGE).parts
        indent = "    " * len(parts)
        if path.name == "__init__.py":
            if len(parts) > 1:
                lines.append(f"{indent[4:]}{parts[-2]}/ ".ljust(34) + first_line(path))
        elif path.suffix == ".js":
            lines.append(f"{indent[4:]}{parts[-2]}/{path.name} ".ljust(34) + first_line(path))
        else:
            lines.append(f"{indent}{path.name} ".ljust(34) + first_line(path))
    return "\n".join(line.rstrip() for line in lines)


def with_tree(text: str) -> str:
    """Return the architecture document with the present tree."""
    begin, end = TREE_MARKS
    before, _, rest = text.partition(begin)
    _, _, after = rest.partition(end)
    return f"{before}{begin}\n\n```text\n{draw_tree()}\n```\n\n{end}{after}"


def read_interfaces() -> list[Interface]:
    """Return the interface of every node, each started alone.

    Subscriptions to private topics of other nodes are left out.
    """
    import rclpy
    from rclpy.parameter import Parameter

    from head_tracking.configuration.simulated import SimulatedJoints
    from head_tracking.programs import NODES, node_class

    nodes = []
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        os.environ |= {"HOME": folder, "ROS_LOG_DIR": folder}
        rclpy.init(args=["--ros-args", "--log-level", "fatal"])
        stack.callback(rclpy.try_shutdown)
        for name in NODES:
            values = NEEDED.get(name, {}).items()
            given: dict[str, Any] = {
                "parameter_overrides": [Parameter(key, value=value) for key, value in values]
            }
            if name == "servo_bus":
                given["simulate"] = lambda joints: SimulatedJoints(joints).open
            nodes.append(read_interface(name, resolve_name(node_class(name)), given))
    private = {
        f"{node.name}/{topic.removeprefix('~/')}"
        for node in nodes
        for topic in node.topics["publishes"]
        if topic.startswith("~/")
    }
    for node in nodes:
        for topic in private & node.topics["subscribes to"].keys():
            del node.topics["subscribes to"][topic]
    return nodes


def read_interface(name: str, kind: Any, given: dict[str, Any]) -> Interface:
    """Start a node and return its interface."""
    from rclpy.node import Node

    defaults: dict[str, Any] = {}
    declare = Node.declare_parameter

    def record(node: Any, parameter: str, value: Any = None, *others: Any, **more: Any) -> Any:
        defaults[parameter] = value
        return declare(node, parameter, value, *others, **more)

    interface = Interface(name, (kind.__doc__ or "").partition("\n")[0])
    with mock.patch.object(Node, "declare_parameter", record):
        node = kind(**given)
    try:
        for own in node.get_node_names_and_namespaces():
            if own[0].startswith(name):
                interface.add("publishes", node.get_publisher_names_and_types_by_node(*own))
                interface.add("subscribes to", node.get_subscriber_names_and_types_by_node(*own))
                interface.add("services", node.get_service_names_and_types_by_node(*own))
        for parameter, default in defaults.items():
            if ROS_PARAMETERS.match(parameter) or "tilt_controller" in parameter:
                continue
            descriptor = node.describe_parameter(parameter)
            interface.parameters.append(
                (
                    f"`{shown(parameter, name)}`",
                    f"`{default}`" if default not in ("", [], ()) else "(empty)",
                    descriptor.additional_constraints,
                    "at the start" if descriptor.read_only else "any time",
                    descriptor.description,
                )
            )
    finally:
        node.destroy_node()
    return interface


def shown(name: str, node: str) -> str:
    """Return a ROS name for documents: private names with ~, controllers as a pattern."""
    name = EXAMPLE_CONTROLLERS.sub("<controller>", name)
    if name in ABSOLUTE:
        return name
    return name.replace(f"/{node}/", "~/", 1) if name.startswith(f"/{node}/") else name.lstrip("/")


def table(header: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """Return a table in Markdown."""
    lines = [header, ("---",) * len(header), *rows]
    return "".join(
        "| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines
    )


def nodes_page(nodes: list[Interface]) -> str:
    """Return the document with all nodes."""
    text = (
        f"{SOURCE_NOTE}# Nodes\n\nStart one with `ros2 run head_tracking NAME`. `~` stands for the "
        "name of the node. Meanings of the topics: [topics.md](topics.md). Parameters: "
        "[parameters.md](parameters.md).\n"
    )
    for node in nodes:
        text += f"\n## {node.name}\n\n{node.summary}\n"
        for direction, names in node.topics.items():
            if not names:
                continue
            listed = ", ".join(f"`{name}`" for name in sorted(names))
            text += f"\n- {direction.capitalize()}: {listed}"
        text += f"\n- [Parameters](parameters.md#{node.name})\n"
    return text


def topics_page(nodes: list[Interface], meanings: dict[str, dict[str, str]]) -> str:
    """Return the document with all topics, services and actions and their meanings.

    Raises:
        SystemExit: the table of meanings lacks a name, or has one that no node uses.
    """
    used: dict[str, dict[str, tuple[str, dict[str, list[str]]]]] = {}
    for node in nodes:
        for direction, names in node.topics.items():
            group = direction if direction in ("services", "actions") else "topics"
            for name, kind in names.items():
                _, users = used.setdefault(group, {}).setdefault(name, (kind, defaultdict(list)))
                users[direction].append(f"`{node.name}`")
    text = f"{SOURCE_NOTE}# Topics, services and actions\n"
    for group, names in used.items():
        known = meanings.get(group, {})
        if names.keys() != known.keys():
            missing, unused = sorted(names.keys() - known), sorted(known.keys() - names)
            raise SystemExit(f"{MEANINGS.name}: [{group}] lacks {missing}; not used: {unused}")
        if group == "topics":
            header: tuple[str, ...] = ("Name", "Type", "From", "To", "Meaning")
            sides: tuple[str, ...] = ("publishes", "subscribes to")
        else:
            header, sides = ("Name", "Type", "Node", "Meaning"), (group,)
        rows = [
            (
                f"`{name}`",
                kind.replace("/msg/", "/").replace("/srv/", "/").replace("/action/", "/"),
                *(", ".join(users[side]) for side in sides),
                known[name],
            )
            for name, (kind, users) in sorted(names.items())
        ]
        text += f"\n## {group.capitalize()}\n\n{table(header, rows)}"
    return text


def parameters_page(nodes: list[Interface]) -> str:
    """Return the document with all parameters."""
    text = (
        f"{SOURCE_NOTE}# Parameters\n\nSet them in a YAML file (`--params FILE`, `--params-file "
        "FILE`) or with `-p NODE:NAME:=VALUE` after `--ros-args`. `<controller>` stands for the "
        "name in `dynamixels` with `_controller` behind it. `any time`: `ros2 param set` works "
        "while the node runs.\n"
    )
    header = ("Parameter", "Default", "Allowed", "Set", "Meaning")
    return text + "".join(f"\n## {node.name}\n\n{table(header, node.parameters)}" for node in nodes)


def command_line_page() -> str:
    """Return the document with the help of all programs."""
    from head_tracking import programs

    text = (
        f"{SOURCE_NOTE}# Command line\n\nAfter `pip install`: `head_tracking NAME`. With a sourced "
        "workspace: `ros2 run head_tracking NAME`.\n"
    )
    for name in ("head_tracking", *programs.TOOLS):
        words = [] if name == "head_tracking" else [name]
        with (
            mock.patch.object(sys, "argv", ["head_tracking", *words, "--help"]),
            redirect_stdout(io.StringIO()) as answer,
        ):
            try:
                programs.head_tracking()
            except SystemExit as ended:
                assert not ended.code, name
        text += f"\n## {name}\n\n```text\n{answer.getvalue().strip()}\n```\n"
    return text


def pages() -> dict[Path, str]:
    """Return all generated documents: path -> text."""
    from head_tracking.compatibility import tomllib

    nodes = read_interfaces()
    return {
        REFERENCE / "nodes.md": nodes_page(nodes),
        REFERENCE / "topics.md": topics_page(nodes, tomllib.loads(MEANINGS.read_text())),
        REFERENCE / "parameters.md": parameters_page(nodes),
        REFERENCE / "command_line.md": command_line_page(),
        ARCHITECTURE: with_tree(ARCHITECTURE.read_text()),
    }


def main() -> int:
    """Write all generated documents, or with --check name those that are stale."""
    stale = {
        path: text
        for path, text in pages().items()
        # the width of lines depends on the version of Python
        if not path.exists() or path.read_text().split() != text.split()
    }
    if "--check" in sys.argv:
        print(*(f"stale: {path.relative_to(ROOT)}" for path in stale), sep="\n")
        return bool(stale)
    for path, text in stale.items():
        path.write_text(text)
        print(f"wrote {path.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    os.environ |= {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF",
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
        "COLUMNS": "100",  # of the help of programs
    }
    raise SystemExit(main())
