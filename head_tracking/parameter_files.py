"""Reads ROS parameter files without ROS, and finds wrong names in them."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from difflib import get_close_matches
from textwrap import shorten
from typing import Any, Final, NamedTuple

import yaml

from head_tracking.exceptions import HeadTrackingError
from head_tracking.parameters import nearest

COMMAND_LINE: Final = "the command line"
"""Stands for the file of a rule."""

_MISSPELT: Final = 0.8  # similarity from which another name of a node is a mistake
_PARAMETERS: Final = "ros__parameters"
_FORMAT: Final = (
    "A parameter file is YAML, such as {/**/servo_bus: {ros__parameters: {baud_rate: 57600}}}"
)
_RULE: Final = re.compile(r"(?:(\w+):)?([\w./]+):=(.*)", re.DOTALL)  # node, parameter, value


class ParameterFileError(HeadTrackingError):
    """A parameter file, or a parameter of the command line, is malformed."""


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """Reads 1e-3 as a number, as ROS does, and refuses a key twice: YAML forgets the first one."""

    def compose_mapping_node(self, anchor: Any) -> Any:
        node = super().compose_mapping_node(anchor)
        keys = [key.value for key, _ in node.value]
        for number, (key, _) in enumerate(node.value):
            if key.value in keys[:number]:
                line = key.start_mark.line + 1
                raise ValueError(f"{key.value!r} is there twice, again in line {line}; join them")
        return node


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+"),
    list("-+.0123456789"),
)


class Given(NamedTuple):
    """One value of a parameter file.

    Attributes:
        file: name of the file, or `COMMAND_LINE`.
        nodes: name or pattern of the nodes, such as `/**/servo_bus`.
        name: of the parameter.
        value: from YAML.
    """

    file: str
    nodes: str
    name: str
    value: Any = None

    def is_for(self, node: str) -> bool:
        """Return whether the pattern matches the full name of a node, by the rules of rcl."""
        pattern = re.escape(self.nodes if self.nodes.startswith("/") else f"/{self.nodes}")
        pattern = pattern.replace(r"/\*\*", r"(/\w+)*").replace(r"/\*", r"/\w+")
        return re.fullmatch(pattern, node) is not None

    @property
    def node(self) -> str:
        """The last part of the pattern; empty for a wildcard."""
        last = self.nodes.rsplit("/", 1)[-1]
        return "" if "*" in last else last


def read(file: str) -> list[Given]:
    """Return all values of a file.

    Raises:
        ParameterFileError: the file cannot be read, or is no parameter file.
    """
    try:
        with open(file, encoding="utf-8") as text:
            content = yaml.load(text, _Loader)
        return list(_values(file, "", content))
    except OSError as error:
        problem = str(error.strerror)
    except UnicodeDecodeError:
        problem = f"it is not text in UTF-8. {_FORMAT}"
    except (yaml.YAMLError, ValueError) as error:
        problem = f"{' '.join(str(error).split())}. {_FORMAT}"
    raise ParameterFileError(f"the parameter file {file} cannot be used: {problem}")


def read_rule(text: str) -> list[Given]:
    """Return the values of a rule of the command line, `name:=value` or `node:name:=value`.

    Raises:
        ParameterFileError: the value is not valid.
    """
    rule = _RULE.fullmatch(text)
    if rule is None:
        return []
    node, name, value = rule.groups()
    nodes = f"/**/{node}" if node else "/**"
    try:
        values = list(_flat(name, yaml.load(value, _Loader)))
        if not values:
            raise ValueError("it has no value")
    except (yaml.YAMLError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise ParameterFileError(f"the parameter {text} cannot be used: {reason}") from error
    return [Given(COMMAND_LINE, nodes, each, value) for each, value in values]


def unknown_parameters(values: Collection[Given], known: Collection[str]) -> Iterator[Given]:
    """Yield a value of each name that no parameter of a node has.

    Values of a file for nodes of any name (`/**`) may be for another one, and those of a servo
    that the node does not use are no mistake.
    """
    names = {given.name for given in values}
    meant = {given.name: given for given in values if given.node or given.file == COMMAND_LINE}
    for name, given in sorted(meant.items()):
        servo = f"{name.split('.', 1)[0]}.motor.id"
        is_unused = servo in names and servo not in known
        if not (name in known or is_unused or name.startswith("qos_overrides.")):
            yield given


def unknown_nodes(values: Iterable[Given], known: Collection[str]) -> Iterator[str]:
    """Yield a text about each misspelt name of a node.

    On the command line each name must exist. In a file, a name that is similar to no known one is
    that of another package's node, and one that contains a known one is right: servo_bus_left may
    be a second servo_bus.
    """
    for file, node in dict.fromkeys((given.file, given.node) for given in values if given.node):
        is_similar = bool(get_close_matches(node, known, 1, _MISSPELT))
        is_wrong = file == COMMAND_LINE or (is_similar and not any(one in node for one in known))
        if node not in known and is_wrong:
            yield f"{file}: there is no node {node}{nearest(node, known)}"


def _values(file: str, nodes: str, content: Any) -> Iterator[Given]:
    if content is None:
        return
    if not isinstance(content, Mapping):
        raise ValueError(f"{shorten(repr(content), 60)} is not a node with ros__parameters")
    for key, value in content.items():
        if key != _PARAMETERS:
            yield from _values(file, f"{nodes}/{str(key).strip('/')}", value)
        elif isinstance(value or {}, Mapping):
            for name, given in _flat("", value):
                yield Given(file, nodes, name, given)
        else:
            raise ValueError(f"the ros__parameters of {nodes} are {shorten(repr(value), 60)}")


def _flat(prefix: str, content: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(content, Mapping):
        for key, value in content.items():
            yield from _flat(f"{prefix}.{key}" if prefix else str(key), value)
    elif isinstance(content, list):
        kinds = set(map(type, content))
        if kinds == {int, float}:
            content = list(map(float, content))
        elif len(kinds) > 1 or kinds & {dict, list}:
            raise ValueError(f"{prefix} is {content!r}, but a list has values of one type")
        yield prefix, content
    elif content is not None:
        yield prefix, content
