"""Watches the graph for other heads: two that share one turn each other's servos."""

from __future__ import annotations

import math
import os
import time
import uuid
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

from head_tracking.exceptions import RefusedError

LOOK_TIME = 3.0
"""So long [s] a run looks before anything moves: a node is heard of after 0.1 to 0.5 s, but when
an announcement is lost, with the next one, up to 3 s later."""
SIMULATED_LOOK_TIME = 1.0
"""The same of a run with simulated servos, which gives way also later."""

_CERTAIN = 0.5  # s: what is gone before was on its way out
_CERTAIN_LATER = 2.0  # s: a run that refuses to start is gone before, and none moves before


class GraphWatch:
    """Finds the other heads of a graph, and says who they are.

    Whoever does not belong to the run and commands its servos counts, or turns a head of the same
    namespace; not who only listens, such as `ros2 topic echo`, RViz or a recording, and not a page,
    which asks who owns a joint before it moves it.

    Args:
        node: looks; only names are asked, no topic or service is used.
        enclave: the run's; all its processes have it, and nobody else.
        hold: called with the reason while nothing may move, and with "" when that is over.
        simulated: the servos are; the run gives way to a head that comes later.
        allow_others: nothing is refused and nothing held; who is there is said.
        alone: somebody has looked already: nothing is held, and nothing refused any more.
        clock: gives the time [s].

    Attributes:
        others: who else turns or commands a head here, as a person reads it; empty: nobody.
    """

    def __init__(
        self,
        node: Node,
        enclave: str,
        hold: Callable[[str], object],
        *,
        simulated: bool,
        allow_others: bool = False,
        alone: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.others = ""
        self._node = node
        self._enclave = enclave
        self._hold = hold
        self._gives_way = simulated
        self._look_time = SIMULATED_LOOK_TIME if simulated else LOOK_TIME
        self._allow_others = allow_others
        self._clock = clock
        self._began = clock()
        self._changed = -math.inf  # when the answer to "is anybody there?" changed
        self._somebody = False
        self._told = False
        self._looking = not (allow_others or alone)
        self._commands = node.resolve_topic_name("joint_commands")
        self._owners = node.resolve_topic_name("joint_owners")
        self._states = node.resolve_topic_name("servo_states")
        self._bus_services = {node.resolve_service_name(name) for name in ("stop", "relax")}
        if self._looking:
            hold("looking for other heads")

    @property
    def looking(self) -> bool:
        """Whether it does not know yet whether there is somebody."""
        return self._looking

    def look(self) -> None:
        """Looks once; to be called a few times a second.

        Raises:
            RefusedError: there is another head, and this run has not moved yet.
        """
        now = self._clock()
        self.others = self._found()
        if bool(self.others) is not self._somebody:
            self._somebody, self._changed = bool(self.others), now
        if now - self._changed < (_CERTAIN if self._looking else _CERTAIN_LATER):
            return
        if self._looking:
            if self._somebody:
                raise RefusedError(f"{self._said()}; {_CURES}")
            if now - self._began >= self._look_time:
                self._looking = False
                self._hold("")
        elif self._somebody is not self._told:
            self._told = self._somebody
            self._tell()

    def _tell(self) -> None:
        log = self._node.get_logger()
        holds = self._gives_way and not self._allow_others
        if self._told:
            log.warning(f"{self._said()}; this run {'holds' if holds else 'goes on'}")
        else:
            log.info(f"the other head has gone{'; this run goes on' if holds else ''}")
        if holds:
            self._hold(self._said() if self._told else "")

    def _said(self) -> str:
        return f"another head is in this graph: {self.others}"

    def _found(self) -> str:
        own: Counter[tuple[str, str]] = Counter()
        everybody: Counter[tuple[str, str]] = Counter()
        for name, namespace, enclave in self._node.get_node_names_and_namespaces_with_enclaves():
            everybody[name, namespace] += 1
            own[name, namespace] += enclave == self._enclave
        strangers = sorted(everybody - own)
        if not strangers:
            return ""
        commanding = _names(self._node.get_publishers_info_by_topic(self._commands))
        obeying = _names(self._node.get_subscriptions_info_by_topic(self._commands))
        asking = _names(self._node.get_subscriptions_info_by_topic(self._owners))
        measuring = _names(self._node.get_publishers_info_by_topic(self._states))
        found = []
        for name, namespace in strangers:
            full_name = f"{namespace.rstrip('/')}/{name}"
            services = self._services(name, namespace)
            if (name, namespace) in obeying and (
                (name, namespace) in measuring or self._bus_services & services
            ):
                found.append(f"{full_name} (moves servos)")
            elif (name, namespace) in commanding and f"{full_name}/recenter" in services:
                found.append(f"{full_name} (turns a head)")
            elif (name, namespace) in commanding and (name, namespace) not in asking:
                found.append(f"{full_name} (publishes {self._commands})")
        return ", ".join(found)

    def _services(self, name: str, namespace: str) -> set[str]:
        with suppress(RuntimeError):  # it has gone meanwhile
            found = self._node.get_service_names_and_types_by_node(name, namespace)
            return {service for service, _ in found}
        return set()


def own_enclave() -> str:
    """A name by which the processes of a run know each other; empty where names have keys.

    An enclave is only a name, unless ROS's security is on and finds its keys by it.
    """
    if os.environ.get("ROS_SECURITY_ENABLE", "").lower() == "true":
        return ""
    return f"/head_tracking/run_{uuid.uuid4().hex[:12]}"


_CURES = (
    "give this run a graph of its own (another ROS_DOMAIN_ID), or names of its own "
    "(--ros-args -r __ns:=/second), or let both command one head (--allow-others)"
)


def _names(endpoints: Iterable[TopicEndpointInfo]) -> set[tuple[str, str]]:
    return {(end.node_name, end.node_namespace) for end in endpoints}
