"""Definitions of messages as text: the installed ones, and those made of the classes."""

import importlib
import re

import pytest

from head_tracking.ros.kit import message_types
from head_tracking.ros.kit.message_types import message_class, message_definition

PACKAGES = ("std_msgs", "geometry_msgs", "sensor_msgs", "diagnostic_msgs", "rcl_interfaces")


def names() -> list[str]:
    return [
        f"{package}/msg/{name}"
        for package in PACKAGES
        for name, found in vars(importlib.import_module(f"{package}.msg")).items()
        if hasattr(found, "get_fields_and_field_types")
    ]


def fields(text: str, package: str) -> list[str]:
    """Type and name of each field of the first type in a definition, without constants."""
    lines = (line.partition("#")[0].split() for line in text.partition("====")[0].splitlines())
    found = (words for words in lines if words and not re.search("[^<]=", " ".join(words)))
    # char is an old name of uint8; a type of the same package needs no package, Header neither
    short = re.compile(rf"^({package}|std_msgs)/")
    return [short.sub("", re.sub(r"^char\b", "uint8", " ".join(w[:2]))) for w in found]


def test_what_is_made_of_a_class_is_what_its_package_installed(monkeypatch):
    installed = {name: message_definition(name) for name in names()}
    assert len(installed) > 80
    assert "# " in installed["sensor_msgs/msg/JointState"]  # there are texts, with their comments
    monkeypatch.setattr(message_types, "_text", message_types._text_from_fields)
    for name, text in installed.items():
        package = name.partition("/")[0]
        assert fields(message_definition(name), package) == fields(text, package), name


def test_types_in_types_are_defined_once_each():
    text = message_definition("tf2_msgs/msg/TFMessage")
    assert re.findall(r"MSG: (.*)", text) == [
        "geometry_msgs/TransformStamped", "std_msgs/Header", "builtin_interfaces/Time",
        "geometry_msgs/Transform", "geometry_msgs/Vector3", "geometry_msgs/Quaternion",
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["no_such_msgs/msg/Thing", "std_msgs/msg/Thing"])
def test_what_is_not_installed_says_so(name):
    with pytest.raises(LookupError, match="not installed"):
        message_class(name)
