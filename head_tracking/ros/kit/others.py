"""The other nodes of a robot: which there are, their services and their parameters."""

from __future__ import annotations

import math
import re
import threading
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, ParameterEvent, ParameterType
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from std_srvs.srv import SetBool, Trigger

from head_tracking.exceptions import HeadTrackingError


class Graph:
    """The nodes of a namespace, and all services, as of the last `look`.

    Args:
        node: in that namespace; nodes whose names begin with its name are left out.

    Attributes:
        namespace: of the nodes.
        nodes: their names without the namespace, sorted.
        services: the full names of all services that are offered or have clients.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.namespace: str = node.get_namespace()
        self.nodes: tuple[str, ...] = ()
        self.services: frozenset[str] = frozenset()

    def look(self) -> None:
        """Discover nodes and services."""
        own, found = self._node.get_name(), self._node.get_node_names_and_namespaces()
        nodes = {name for name, namespace in found if namespace == self.namespace}
        self.nodes = tuple(sorted(name for name in nodes if not name.startswith(own)))
        services = self._node.get_service_names_and_types()
        self.services = frozenset(name for name, _ in services)

    def is_own(self, node: str) -> bool:
        """Return whether a node, given by its full name, is in the namespace."""
        return "/" + node.lstrip("/").rpartition("/")[0] == self.namespace

    def is_below(self, name: str) -> bool:
        """Return whether a full name is in the namespace or in one below it."""
        return name.startswith(self.namespace.rstrip("/") + "/")


_PATIENCE = 15.0  # s: a slow machine may need so long to start a node


class OtherServices:
    """Calls services of other nodes. A call that does not succeed raises HeadTrackingError.

    Args:
        node: has the clients; another thread must spin it.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._clients: dict[str, Any] = {}
        self._lock = threading.Lock()

    def know(self, kind: type[SetBool] | type[Trigger], *names: str) -> None:
        """Create clients in advance, so that they have discovered their services when called."""
        with self._lock:
            for name in names:
                if name not in self._clients:
                    self._clients[name] = self._node.create_client(kind, name)

    def offered(self, name: str) -> bool:
        """Return whether a node offers a known service."""
        client = self._clients.get(name)
        return client is not None and bool(client.service_is_ready())

    def trigger(self, name: str) -> str:
        """Call a Trigger service; return the message of its answer."""
        return self._call(name, Trigger.Request())

    def switch(self, name: str, on: bool) -> str:
        """Call a SetBool service; return the message of its answer."""
        return self._call(name, SetBool.Request(data=on))

    def _call(self, name: str, request: Any) -> str:
        if not self.offered(name):
            raise HeadTrackingError(f"no node offers {name}; is its node running?")
        return message_of(wait_for_answer(self._clients[name], request))


def message_of(answer: SetBool.Response | Trigger.Response) -> str:
    """Return the message of an answer; raise HeadTrackingError with it if that is a refusal."""
    if not answer.success:
        raise HeadTrackingError(answer.message or "refused without a reason")
    return str(answer.message)


def wait_for_answer(client: Any, request: Any, patience: float = _PATIENCE) -> Any:
    """Call a service and return its response; another thread must spin the client's node.

    Raises:
        HeadTrackingError: there is none after `patience` [s].
    """
    answered = threading.Event()
    future = client.call_async(request)
    future.add_done_callback(lambda _: answered.set())
    if not answered.wait(patience):
        client.remove_pending_request(future)
        raise HeadTrackingError(f"{client.service_name} did not answer within {patience:g} s")
    return future.result()


_SERVICES = {
    "list_parameters": ListParameters,
    "describe_parameters": DescribeParameters,
    "get_parameters": GetParameters,
    "set_parameters": SetParameters,
}
_HUGE = 1e9
"""A bound beyond this is no bound: nodes describe `no maximum` by the largest number."""

_TYPES = {
    ParameterType.PARAMETER_BOOL,
    ParameterType.PARAMETER_INTEGER,
    ParameterType.PARAMETER_DOUBLE,
    ParameterType.PARAMETER_STRING,
    ParameterType.PARAMETER_DOUBLE_ARRAY,
}
_CHOICES = "one of: "
_UNIT = re.compile(r"(?P<text>.*) \[(?P<unit>[^\[\]]*)\]", re.DOTALL)
"""A description with its unit, as NodeParameters writes it: a descriptor has no field for it."""


@dataclass(frozen=True, slots=True)
class Setting:
    """A parameter of a node that can be changed while it runs."""

    node: str  # full name of the node
    name: str  # name of the parameter
    value: Any  # a bool, int, float, str, or list of floats
    description: str  # what it does
    minimum: float  # smallest allowed number; -inf for none
    maximum: float  # largest allowed number; inf for none
    choices: tuple[str, ...] = ()  # the allowed words; empty for any
    unit: str = ""  # of a number; empty: none is known


class OtherParameters:
    """The parameters of the nodes of a namespace.

    `look` must be called in the node's thread, everything else may be called in any thread.

    Args:
        node: has the clients.
        graph: the nodes.
    """

    def __init__(self, node: Node, graph: Graph) -> None:
        self._node = node
        self._graph = graph
        self._clients: dict[str, dict[str, Any]] = {}
        self._settings: dict[str, dict[str, Setting]] = {}
        node.create_subscription(ParameterEvent, "/parameter_events", self._on_event, 100)

    def look(self) -> None:
        """Read the parameters of new nodes, and discard those of nodes that have ended."""
        base = self._graph.namespace.rstrip("/")
        found = {
            f"{base}/{name}"
            for name in self._graph.nodes
            if f"{base}/{name}/list_parameters" in self._graph.services
        }
        silent = {owner for owner in self._settings if not self._answers(owner)}
        for owner in (self._clients.keys() - found) | silent:
            for client in self._clients.pop(owner, {}).values():
                self._node.destroy_client(client)
            self._settings.pop(owner, None)
        for owner in found - self._clients.keys() - silent:
            self._clients[owner] = {
                name: self._node.create_client(kind, f"{owner}/{name}")
                for name, kind in _SERVICES.items()
            }
        for owner in filter(self._answers, self._clients.keys() - self._settings.keys()):
            self._settings[owner] = {}
            reading = (owner, self._clients[owner])
            threading.Thread(target=self._read, args=reading, daemon=True).start()

    def settings(self) -> tuple[Setting, ...]:
        """Return all parameters that can be changed, sorted by node.

        Free text, such as names of frames and topics or a robot model, is left out: a wrong one can
        end its node.
        """
        owners = dict(self._settings)
        return tuple(
            setting for owner in sorted(owners) for setting in list(owners[owner].values())
        )

    def set(self, owner: str, name: str, value: Any) -> str:
        """Set a parameter; return its name and value.

        Raises:
            HeadTrackingError: the node has ended, does not answer, or refuses the value.
        """
        clients = self._clients.get(owner)
        if clients is None:
            raise HeadTrackingError(f"the node {owner} has ended")
        request = SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()]
        )
        result = wait_for_answer(clients["set_parameters"], request).results[0]
        if not result.successful:
            raise HeadTrackingError(result.reason or f"{owner} refuses {name} = {value}")
        return f"{name} = {value}"

    def _answers(self, owner: str) -> bool:
        """Return whether a node runs. Its services stay listed as long as they have clients."""
        clients = self._clients.get(owner, {})
        return bool(clients) and all(client.service_is_ready() for client in clients.values())

    def _read(self, owner: str, clients: Mapping[str, Any]) -> None:
        """Read the parameters of a node; at the next `look` again, if it does not answer."""
        try:
            listed = wait_for_answer(clients["list_parameters"], ListParameters.Request()).result
            names = [name for name in listed.names if not _is_of_every_node(name)]
            found = _described(owner, clients, names)
        except (HeadTrackingError, InvalidHandle):
            self._settings.pop(owner, None)
        else:
            self._settings[owner] = found

    def _on_event(self, event: ParameterEvent) -> None:
        settings = self._settings.get(event.node, {})
        for changed in event.changed_parameters:
            if changed.name not in settings:
                continue
            if changed.value.type in _TYPES:
                value = _plain(changed.value)
                settings[changed.name] = replace(settings[changed.name], value=value)
            else:
                self._settings.pop(event.node, None)  # ask the node again


def _described(owner: str, clients: Mapping[str, Any], names: Sequence[str]) -> dict[str, Setting]:
    """Ask a node about parameters; return those that can be changed by their names."""
    about = DescribeParameters.Request(names=names)
    descriptors = wait_for_answer(clients["describe_parameters"], about).descriptors
    got = GetParameters.Request(names=names)
    values = wait_for_answer(clients["get_parameters"], got).values
    if not len(names) == len(descriptors) == len(values):
        # a node leaves out all if one has no value or has been undeclared: ask for fewer
        half = len(names) // 2
        parts = (names[:half], names[half:]) if half else ()
        return {k: v for part in parts for k, v in _described(owner, clients, part).items()}
    settings = (
        _setting(owner, name, _plain(value), descriptor)
        for name, descriptor, value in zip(names, descriptors, values, strict=True)
        if value.type in _TYPES and not descriptor.read_only
    )
    return {each.name: each for each in settings if not isinstance(each.value, str) or each.choices}


def _setting(owner: str, name: str, value: Any, descriptor: ParameterDescriptor) -> Setting:
    minimum, maximum = -math.inf, math.inf
    for bounds in (*descriptor.floating_point_range, *descriptor.integer_range):
        minimum, maximum = float(bounds.from_value), float(bounds.to_value)
    constraints = descriptor.additional_constraints
    described = _UNIT.fullmatch(descriptor.description)
    return Setting(
        owner,
        name,
        value,
        described["text"] if described else descriptor.description,
        minimum if minimum > -_HUGE else -math.inf,
        maximum if maximum < _HUGE else math.inf,
        tuple(constraints.removeprefix(_CHOICES).split(", "))
        if constraints.startswith(_CHOICES) and isinstance(value, str)
        else (),
        described["unit"] if described else "",
    )


def _plain(value: Any) -> Any:
    plain = parameter_value_to_python(value)
    return list(plain) if isinstance(plain, array) else plain


def _is_of_every_node(name: str) -> bool:
    return name in ("use_sim_time", "start_type_description_service") or name.startswith(
        "qos_overrides."
    )
