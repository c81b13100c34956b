"""Definitions of messages, made from their classes."""

import importlib
import importlib.util
import re
from pathlib import Path

import pytest

from head_tracking.ros.kit.message_types import message_class, message_definition

PACKAGES = ("geometry_msgs", "sensor_msgs", "rcl_interfaces")


def installed(package: str) -> dict[str, str]:
    """Return the .msg files of a package by type."""
    origin = importlib.util.find_spec(package).origin
    folders = (parent / "share" / package / "msg" for parent in Path(origin).parents)
    folder = next(filter(Path.is_dir, folders))
    return {f"{package}/msg/{file.stem}": file.read_text() for file in folder.glob("*.msg")}


def fields(text: str, package: str) -> list[str]:
    """Type and name of each field of the first type in a definition, without constants."""
    lines = (line.partition("#")[0].split() for line in text.partition("====")[0].splitlines())
    found = (words for words in lines if words and not re.search("[^<]=", " ".join(words)))
    # char is an old name of uint8; a type of the same package needs no package, Header neither
    short = re.compile(rf"^({package}|std_msgs)/")
    return [short.sub("", re.sub(r"^char\b", "uint8", " ".join(w[:2]))) for w in found]


@pytest.mark.parametrize("package", PACKAGES)
def test_a_definition_has_the_fields_of_the_installed_file(package):
    texts = installed(package)
    assert texts
    for name, text in texts.items():
        assert fields(message_definition(name), package) == fields(text, package), name


@pytest.mark.parametrize("name", ["no_such_msgs/msg/Thing", "std_msgs/msg/Thing"])
def test_a_type_that_is_not_installed_is_an_error(name):
    with pytest.raises(LookupError):
        message_class(name)
