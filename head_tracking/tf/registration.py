"""How each type of message is transformed: tf2_ros's registration."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from geometry_msgs.msg import TransformStamped

DoTransform: TypeAlias = Callable[[Any, TransformStamped], Any]


class TypeException(Exception):
    """A message cannot be transformed."""

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
