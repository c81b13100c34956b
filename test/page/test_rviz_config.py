"""config/head.rviz as RViz would read it; RViz itself is not here to read it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

CONFIG = Path(__file__).parents[2] / "config" / "head.rviz"

CLASSES = {
    "rviz_common": {"Displays", "Tool Properties", "Views"},
    "rviz_default_plugins": {
        *("Grid", "RobotModel", "TF", "PointStamped", "Marker"),
        *("MoveCamera", "Select", "PublishPoint", "Orbit"),
    },
}
"""The plugins that the file names, as Jazzy's plugins_description.xml files spell them."""

POLICIES = {
    "Durability Policy": {"Volatile", "Transient Local"},
    "History Policy": {"Keep Last"},
    "Reliability Policy": {"Reliable", "Best effort"},
}


class Strict(yaml.SafeLoader):
    """Refuses a key that comes twice, of which YAML would quietly keep the last."""

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        keys = [key.value for key, _ in node.value]
        assert len(keys) == len(set(keys)), f"a key comes twice at {node.start_mark}"
        return super().construct_mapping(node, deep)


def all_mappings(part: Any) -> Iterator[dict[str, Any]]:
    if isinstance(part, dict):
        yield part
        part = list(part.values())
    if isinstance(part, list):
        for one in part:
            yield from all_mappings(one)


@pytest.fixture(scope="module")
def config() -> Any:
    return yaml.load(CONFIG.read_text(), Loader=Strict)


def test_rviz_knows_every_class(config):
    classes = [one["Class"] for one in all_mappings(config) if one.get("Class")]
    assert len(classes) >= 12
    for one in classes:
        package, name = one.split("/")
        assert name in CLASSES[package]


def test_colours_and_qualities_are_written_as_rviz_writes_them(config):
    for part in all_mappings(config):
        for key, value in part.items():
            if key.endswith("Color"):
                numbers = [int(number) for number in value.split("; ")]
                assert len(numbers) == 3 and all(0 <= number <= 255 for number in numbers)
            if key in POLICIES:
                assert value in POLICIES[key]
            if key.endswith("Topic") and isinstance(value, dict):
                assert value["Value"].startswith("/")
                assert value["Depth"] > 0
