"""Watches the graph for other heads: two that share one turn each other's servos."""

from __future__ import annotations

import math
import os
import time
import uuid
from collections.abc import Callable, Iterable
from contextlib import suppress

from rclpy.context import Context
from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

from head_tracking.exceptions import RefusedError

LOOK_TIME = 3.0
"""So long [s] a run looks before anything moves: a node is heard of after 0.1 to 0.5 s, but when
an announcement is lost, with the next one, up to 3 s later."""
SIMULATED_LOOK_TIME = 1.0
"""The same of a run with simulated servos; it has no nodes before, and looks on while it makes
them."""
STARTING = "head_tracking_starting"
"""The node of a run that looks: as long as it is there nothing of the run moves."""

_CERTAIN = 0.5  # s: what is gone before was on its way out
_WHOLE = 2.0  # s in which all topics of a node are known, not only the first


class GraphWatch:
    """Finds the other heads of a graph, and says who they are.

    Whoever does not belong to the run and commands its servos counts, or turns a head of the same
    namespace; not who only listens, such as `ros2 topic echo`, RViz or a recording, and not a page,
    which asks who owns a joint before it moves it. Of two runs that start at the same moment, or
    hear of each other too late, the one goes on whose enclave sorts first; see `own_enclave`.

    Args:
        enclave: the run's; all its processes have it, and nobody else.
        simulated: the servos are; the run gives way also later, to heads that are no runs.
        allow_others: nothing is refused and nothing held; who is there is said.
        context: of ROS; None: the default one.
        clock: gives the time [s].

    Attributes:
        others: who else turns or commands a head here, as a person reads it; empty: nobody.
        held: why nothing may move; empty: it may.
        looking: whether the run has not begun.
    """

    def __init__(
        self,
        enclave: str,
        *,
        simulated: bool,
        allow_others: bool = False,
        context: Context | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.others = ""
        self.looking = True
        self.held = "" if allow_others else "looking for other heads"
        self._node = Node(
            STARTING, context=context, start_parameter_services=False, enable_rosout=False
        )
        self._enclave = enclave
        self._simulated = simulated
        self._look_time = SIMULATED_LOOK_TIME if simulated else LOOK_TIME
        self._allow_others = allow_others
        self._clock = clock
        self._began = clock()
        self._found, self._changed = (False, False), -math.inf  # others; before whom it gives way
        self._told = self._found
        self._unasked: dict[tuple[str, str, str], float] = {}
        self._commands = self._node.resolve_topic_name("joint_commands")
        self._owners = self._node.resolve_topic_name("joint_owners")
        self._states = self._node.resolve_topic_name("servo_states")
        self._bus_services = {self._node.resolve_service_name(name) for name in ("stop", "relax")}

    @property
    def alone(self) -> bool:
        """Whether it has looked for long enough, and knows of nobody."""
        now = self._clock()
        return self._allow_others or not (
            self._unasked
            or self._found[0]
            or now - self._changed < _CERTAIN
            or now - self._began < self._look_time
        )

    def begin(self, node: Node) -> None:
        """Lets the run move, and goes on looking with a node of it, in the same namespace."""
        self._node.destroy_node()
        self._node, self.looking, self.held = node, False, ""

    def look(self) -> None:
        """Looks once; to be called a few times a second.

        Raises:
            RefusedError: there is another head, and this run has not begun.
        """
        now = self._clock()
        heads = self._heads(now)
        self.others = ", ".join(heads)
        found = bool(heads), any(heads.values())
        if found != self._found:
            self._found, self._changed = found, now
        if now - self._changed < _CERTAIN:
            return
        if self.looking:
            if heads and not self._allow_others:
                raise RefusedError(f"{self._said()}; {_CURES}")
        elif found != self._told:
            self._tell()

    def _tell(self) -> None:
        log = self._node.get_logger()
        self._told = somebody, first = self._found
        held, self.held = self.held, self._said() if first and not self._allow_others else ""
        if somebody:
            log.warning(f"{self._said()}; this run {'holds' if self.held else 'goes on'}")
        else:
            log.info(f"the other head has gone{'; this run goes on' if held else ''}")

    def _said(self) -> str:
        return f"another head is in this graph: {self.others}"

    def _heads(self, now: float) -> dict[str, bool]:
        """Who they are, and whether this run gives way to them."""
        nodes = set(self._node.get_node_names_and_namespaces_with_enclaves())
        here = self._node.get_namespace()
        starting = {each[2] for each in nodes if each[:2] == (STARTING, here)}
        strangers = sorted(node for node in nodes if node[2] != self._enclave)
        if not strangers:
            self._unasked.clear()
            return {}
        commanding = _names(self._node.get_publishers_info_by_topic(self._commands))
        obeying = _names(self._node.get_subscriptions_info_by_topic(self._commands))
        asking = _names(self._node.get_subscriptions_info_by_topic(self._owners))
        measuring = _names(self._node.get_publishers_info_by_topic(self._states))
        heads: dict[str, bool] = {}
        unasked: dict[tuple[str, str, str], float] = {}
        for stranger in strangers:
            name, namespace, enclave = stranger
            full_name = f"{namespace.rstrip('/')}/{name}"
            does = ""
            if enclave in starting:  # and not before this run, if this one has begun
                if self.looking and enclave < self._enclave and name == STARTING:
                    does = "a run that starts, before this one"
            elif (name, namespace) in obeying and (
                (name, namespace) in measuring
                or self._bus_services & self._services(name, namespace)
            ):
                does = "moves servos"
            elif (name, namespace) in commanding:
                if f"{full_name}/recenter" in self._services(name, namespace):
                    does = "turns a head"
                elif (name, namespace) not in asking:
                    since = unasked[stranger] = self._unasked.get(stranger, now)
                    if now - since >= _WHOLE:
                        does = f"publishes {self._commands}"
            if does:
                head = f"{full_name} ({does})"  # of several runs, as they have the same names
                heads[head] = heads.get(head, False) or self._goes_first(enclave)
        self._unasked = unasked
        return heads

    def _goes_first(self, enclave: str) -> bool:
        """Whether this run gives way to what has that enclave, once both have begun."""
        if enclave.startswith(_RUN) and self._enclave.startswith(_RUN):
            return enclave < self._enclave
        return self._simulated

    def _services(self, name: str, namespace: str) -> set[str]:
        with suppress(RuntimeError):  # it has gone meanwhile
            found = self._node.get_service_names_and_types_by_node(name, namespace)
            return {service for service, _ in found}
        return set()


def own_enclave(*, simulated: bool) -> str:
    """A name by which the processes of a run know each other; empty where names have keys.

    An enclave is only a name, unless ROS's security is on and finds its keys by it. Those of runs
    are in an order: real ones before simulated ones, older ones before younger ones.
    """
    if os.environ.get("ROS_SECURITY_ENABLE", "").lower() == "true":
        return ""
    kind = "simulated" if simulated else "real"
    return f"{_RUN}{kind}_{time.time_ns():020d}_{uuid.uuid4().hex[:12]}"


_RUN = "/head_tracking/"
_CURES = (
    "give this run a graph of its own (another ROS_DOMAIN_ID), or names of its own "
    "(--ros-args -r __ns:=/second), or let both command one head (--allow-others)"
)


def _names(endpoints: Iterable[TopicEndpointInfo]) -> set[tuple[str, str]]:
    return {(end.node_name, end.node_namespace) for end in endpoints}
