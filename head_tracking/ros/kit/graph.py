"""Which nodes and services there are in the namespace of one robot."""

from __future__ import annotations

from collections.abc import Mapping

from rclpy.node import Node
from rclpy.node import NodeNameNonExistentError as NodeHasGone


class Graph:
    """The nodes of a namespace, and what they offer. Other robots are in other namespaces.

    Args:
        node: in that namespace; it and those whose names begin with its name are left out.
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
        """Type by full name."""
        return self._services

    def look(self) -> None:
        """Finds out what is there now."""
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
        """Whether a node belongs to the namespace.

        Args:
            node: its full name, with or without the slash before it.
        """
        return "/" + node.lstrip("/").rpartition("/")[0] == self.namespace

    def is_below(self, name: str) -> bool:
        """Whether a full name lies in the namespace, or in one below it."""
        return name.startswith(self.namespace.rstrip("/") + "/")
