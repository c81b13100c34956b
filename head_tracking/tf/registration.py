"""How messages and other types are transformed and converted: tf2_ros's registration."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import Any, TypeAlias

from geometry_msgs.msg import TransformStamped
from std_msgs.msg import Header

DoTransform: TypeAlias = Callable[[Any, TransformStamped], Any]
Convert: TypeAlias = Callable[[Any], Any]


class TypeException(Exception):
    """A message cannot be transformed or converted."""

    def __init__(self, errstr: str) -> None:
        super().__init__(errstr)
        self.errstr = errstr


class TransformRegistration:
    """The function that transforms each type of message; one table for the whole program."""

    _callbacks: dict[type, DoTransform] = {}  # noqa: RUF012 it is shared, as tf2's is

    def add(self, key: type, callback: DoTransform) -> None:
        """Transform messages of this type by `callback(message, transform_stamped)`."""
        self._callbacks[key] = callback

    def get(self, key: type) -> DoTransform:
        """Return the function for messages of this type.

        Raises:
            TypeException: none is registered.
        """
        if key not in self._callbacks:
            known = ", ".join(kind.__name__ for kind in self._callbacks)
            raise TypeException(
                f"a {key.__name__} cannot be transformed; types that can be: {known}"
            )
        return self._callbacks[key]


class ConvertRegistration:
    """The functions that convert types into each other; one table for the whole program."""

    _to_msg: dict[Any, Convert] = {}  # noqa: RUF012 it is shared, as tf2's is
    _from_msg: dict[Any, Convert] = {}  # noqa: RUF012
    _convert: dict[Any, Convert] = {}  # noqa: RUF012

    def add_from_msg(self, key: type, callback: Convert) -> None:
        """Make objects of this type from a message by `callback`."""
        self._from_msg[key] = callback

    def add_to_msg(self, key: type, callback: Convert) -> None:
        """Make messages from an object of this type by `callback`."""
        self._to_msg[key] = callback

    def add_convert(self, key: tuple[type, type], callback: Convert) -> None:
        """Convert objects of the first type to the second type by `callback`."""
        self._convert[key] = callback

    def get_from_msg(self, key: type) -> Convert:
        """Return what was added for the type, or raise a TypeException."""
        return _registered(self._from_msg, key)

    def get_to_msg(self, key: type) -> Convert:
        """Return what was added for the type, or raise a TypeException."""
        return _registered(self._to_msg, key)

    def get_convert(self, key: tuple[type, type]) -> Convert:
        """Return what was added for the two types, or raise a TypeException."""
        return _registered(self._convert, key)


def _registered(table: dict[Any, Convert], key: Any) -> Convert:
    if key not in table:
        raise TypeException(f"no conversion is registered for {key}")
    return table[key]


def convert(a: Any, b_type: type) -> Any:
    """Convert an object to another type: directly, as a copy, or through a message.

    Raises:
        TypeException: no conversion is registered.
    """
    registration = ConvertRegistration()
    try:
        direct = registration.get_convert((type(a), b_type))
    except TypeException:
        if type(a) is b_type:
            return deepcopy(a)
        made = registration.get_from_msg(b_type)(registration.get_to_msg(type(a))(a))
        if not isinstance(made, b_type):
            raise TypeException(f"a {type(a).__name__} cannot become a {b_type.__name__}") from None
        return made
    return direct(a)


def Stamped(obj: Any, stamp: Any, frame_id: str) -> Any:
    """Give an object a header with this stamp and frame, and return it."""
    obj.header = Header(frame_id=frame_id, stamp=stamp)
    return obj
