"""The nodes and services in the namespace of one robot."""

from __future__ import annotations

from collections.abc import Mapping

from rclpy.node import Node
from rclpy.node import NodeNameNonExistentError as NodeHasGone


class Graph:
    """The nodes of a namespace and their services, as of the last `look`.

    Args:
        node: in that namespace; nodes whose names begin with its name are left out.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.namespace: str = node.get_namespace()
        self._nodes: tuple[str, ...] = ()
        self._services: Mapping[str, str] = {}

    @property
    def nodes(self) -> tuple[str, ...]:
        """Their names without the namespace, sorted."""
        return self._nodes

    @property
    def services(self) -> Mapping[str, str]:
        """The type of each service by its full name."""
        return self._services

    def look(self) -> None:
        """Discover nodes and services."""
        own = self._node.get_name()
        nodes: set[str] = set()
        services: dict[str, str] = {}
        for name, namespace in self._node.get_node_names_and_namespaces():
            if namespace != self.namespace or name.startswith(own):
                continue
            nodes.add(name)
            try:
                offered = self._node.get_service_names_and_types_by_node(name, namespace)
            except NodeHasGone:
                continue
            services.update((service, types[0]) for service, types in offered)
        self._nodes, self._services = tuple(sorted(nodes)), services

    def is_own(self, node: str) -> bool:
        """Return whether a node, given by its full name, is in the namespace."""
        return "/" + node.lstrip("/").rpartition("/")[0] == self.namespace

    def is_below(self, name: str) -> bool:
        """Return whether a full name is in the namespace or in one below it."""
        return name.startswith(self.namespace.rstrip("/") + "/")
