"""MCAP files as rosbag2 writes them: profile ros2, definitions of the messages, QoS of publishers.

Format: https://mcap.dev/spec; the channels' metadata as rosbag2_storage_mcap reads them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import IO, Any

import yaml
from mcap.writer import Writer
from rclpy.qos import QoSProfile

from head_tracking.ros.kit.message_types import message_definition

_CHUNK = 1 << 20  # bytes


def offer(profile: QoSProfile) -> dict[str, Any]:
    """Return a publisher's quality of service as rosbag2 writes it (its format 9)."""

    def duration(of: Any) -> dict[str, int]:
        seconds, nanoseconds = divmod(of.nanoseconds, 1_000_000_000)
        return {"sec": seconds, "nsec": nanoseconds}

    return {
        "history": profile.history.name.lower(),
        "depth": profile.depth,
        "reliability": profile.reliability.name.lower(),
        "durability": profile.durability.name.lower(),
        "deadline": duration(profile.deadline),
        "lifespan": duration(profile.lifespan),
        "liveliness": profile.liveliness.name.lower(),
        "liveliness_lease_duration": duration(profile.liveliness_lease_duration),
        "avoid_ros_namespace_conventions": profile.avoid_ros_namespace_conventions,
    }


class BagWriter:
    """Writes one file. Complete chunks can be read even if the file is not finished.

    Args:
        stream: receives the file; it is not closed.

    Attributes:
        writer: of the format's library.
    """

    def __init__(self, stream: IO[bytes]) -> None:
        self.writer = Writer(stream, chunk_size=_CHUNK)
        self.writer.start(profile="ros2", library="head_tracking")
        self._schemas: dict[str, int] = {}

    def channel(
        self, topic: str, kind: str, offers: Sequence[Mapping[str, Any]], type_hash: str
    ) -> int:
        """Register a channel; return its number.

        Args:
            topic: its full name.
            kind: the name of its type.
            offers: the quality of service of its publishers.
            type_hash: of its type; empty: not known.

        Raises:
            LookupError: the package of its type is not installed.
        """
        if kind not in self._schemas:
            definition = message_definition(kind).encode()
            self._schemas[kind] = self.writer.register_schema(kind, "ros2msg", definition)
        plain = [dict(offer) for offer in offers]
        metadata = {"offered_qos_profiles": yaml.dump(plain, Dumper=_Dumper, sort_keys=False)}
        if type_hash:
            metadata["topic_type_hash"] = type_hash
        return self.writer.register_channel(topic, "cdr", self._schemas[kind], metadata)


class _Dumper(yaml.SafeDumper):
    """Writes no anchors: other readers may not support them."""

    def ignore_aliases(self, _: Any) -> bool:
        return True
