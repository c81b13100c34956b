"""Messages whose values are as bad as their types allow."""

import math
import random
from typing import Any, TypeVar

from head_tracking.ros.kit.message_types import message_class

NUMBERS = (0.0, -1.0, 1e-320, 1e308, math.nan, math.inf, -math.inf)
TEXTS = (
    "", "n/a", "/", "/a", "//", "a", "camera", "base_link", "head_pan_joint", "<robot",
    "servo_bus: head_pan_joint", "on target: ", "rgb8", "mono16", "32FC1", "bayer_rggb8", "yuv422",
    "ä\n\t\x01", "x" * 999,
)  # fmt: skip
M = TypeVar("M")


def message_with(rnd: random.Random, kind: type) -> Any:
    """Return a message in which every value is a bad one."""
    fields = kind.get_fields_and_field_types()  # type: ignore[attr-defined]
    return kind(**{name: _filled(rnd, of) for name, of in fields.items()})


def spoiled(rnd: random.Random, message: M) -> M:
    """Return a message after up to three of its fields, or of its parts' fields, are made bad."""
    for _ in range(rnd.randrange(4)):
        _spoil(rnd, message)
    return message


def _spoil(rnd: random.Random, message: Any) -> None:
    name, kind = rnd.choice(list(message.get_fields_and_field_types().items()))
    if "/" in kind and "[" not in kind and not kind.startswith("sequence<"):
        _spoil(rnd, getattr(message, name))
    else:
        setattr(message, name, _filled(rnd, kind))


def _filled(rnd: random.Random, kind: str) -> Any:
    """Return a value of a message's field."""
    name, _, rest = kind.partition("[")
    if kind.startswith("sequence<"):
        inner = kind[len("sequence<") : -1].partition(",")[0]
        return [_filled(rnd, inner) for _ in range(rnd.choice((0, 1, 3)))]
    if rest:
        return [_filled(rnd, name) for _ in range(int(rest[:-1]))]
    if kind in ("float", "double"):
        return rnd.choice(NUMBERS if kind == "double" else NUMBERS[:3])
    if kind == "boolean":
        return rnd.random() < 0.5
    if kind == "octet":
        return bytes([rnd.choice((0, 2, 3, 4, 9, 255))])
    if kind.startswith("string"):
        return rnd.choice(TEXTS)
    if "/" in kind:
        package, _, message = kind.partition("/")
        return message_with(rnd, message_class(f"{package}/msg/{message}"))
    unsigned, bits = kind.startswith("u"), int(kind.strip("uint"))
    highest = 2**bits - 1 if unsigned else 2 ** (bits - 1) - 1
    return rnd.choice((0, 1, highest, 0 if unsigned else -highest - 1))
