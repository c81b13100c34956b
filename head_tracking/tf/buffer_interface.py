"""What every kind of transform buffer can do with messages; tf2_ros's names and arguments."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import Any, TypeAlias

from builtin_interfaces.msg import Time as TimeMsg
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.time import Time
from std_msgs.msg import Header

from head_tracking.transforms import TransformException

AnyTime: TypeAlias = Time | TimeMsg
DoTransform: TypeAlias = Callable[[Any, TransformStamped], Any]


class TypeException(Exception):
    """A message that cannot be transformed or converted."""

    def __init__(self, errstr: str) -> None:
        super().__init__(errstr)
        self.errstr = errstr


class NotImplementedException(Exception):
    """A kind of buffer that cannot look transforms up."""

    def __init__(self) -> None:
        self.errstr = "can_transform or lookup_transform is not implemented"
        super().__init__(self.errstr)


class TransformRegistration:
    """How to transform each type of message; one table for the whole program."""

    _callbacks: dict[type, DoTransform] = {}  # noqa: RUF012 it is shared, as tf2's is

    def add(self, key: type, callback: DoTransform) -> None:
        """Messages of this type are transformed by `callback(message, transform_stamped)`."""
        self._callbacks[key] = callback

    def get(self, key: type) -> DoTransform:
        """What transforms messages of this type.

        Raises:
            TypeException: nothing does; lists the types that can be transformed.
        """
        try:
            return self._callbacks[key]
        except KeyError:
            known = ", ".join(kind.__name__ for kind in self._callbacks)
            raise TypeException(
                f"a {key.__name__} cannot be transformed; possible are {known}"
            ) from None

    def print_me(self) -> None:
        """Prints the table."""
        print(self._callbacks)


class ConvertRegistration:
    """How to convert types into each other; one table for the whole program."""

    _to_msg: dict[type, Callable[[Any], Any]] = {}  # noqa: RUF012 it is shared, as tf2's is
    _from_msg: dict[type, Callable[[Any], Any]] = {}  # noqa: RUF012
    _convert: dict[tuple[type, type], Callable[[Any], Any]] = {}  # noqa: RUF012

    def add_from_msg(self, key: type, callback: Callable[[Any], Any]) -> None:
        """An object of this type is made from a message by `callback`."""
        self._from_msg[key] = callback

    def add_to_msg(self, key: type, callback: Callable[[Any], Any]) -> None:
        """An object of this type becomes a message by `callback`."""
        self._to_msg[key] = callback

    def add_convert(self, key: tuple[type, type], callback: Callable[[Any], Any]) -> None:
        """An object of the first type becomes one of the second by `callback`."""
        self._convert[key] = callback

    def get_from_msg(self, key: type) -> Callable[[Any], Any]:
        """What `add_from_msg` took; TypeException if it took nothing."""
        return _registered(self._from_msg, key)

    def get_to_msg(self, key: type) -> Callable[[Any], Any]:
        """What `add_to_msg` took; TypeException if it took nothing."""
        return _registered(self._to_msg, key)

    def get_convert(self, key: tuple[type, type]) -> Callable[[Any], Any]:
        """What `add_convert` took; TypeException if it took nothing."""
        return _registered(self._convert, key)


def convert(a: Any, b_type: type) -> Any:
    """The object as another type: directly, as a copy, or by way of a message.

    Raises:
        TypeException: nobody registered how.
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
    """The object, with a header of this stamp and frame."""
    obj.header = Header(frame_id=frame_id, stamp=stamp)
    return obj


class BufferInterface:
    """What can be asked of a buffer that can look transforms up.

    Attributes:
        registration: how to transform each type of message.
    """

    def __init__(self) -> None:
        self.registration = TransformRegistration()

    def transform(
        self,
        object_stamped: Any,
        target_frame: str,
        timeout: Duration | None = None,
        new_type: type | None = None,
    ) -> Any:
        """A stamped message in `target_frame`, at its own stamp; of another type if wanted.

        Raises:
            TypeException: a message that cannot be transformed or converted.
            TransformException: see `lookup_transform`.
        """
        do_transform = self.registration.get(type(object_stamped))
        at = object_stamped.header
        found = self.lookup_transform(target_frame, at.frame_id, at.stamp, timeout or Duration())
        moved = do_transform(object_stamped, found)
        return moved if new_type is None else convert(moved, new_type)

    def transform_full(
        self,
        object_stamped: Any,
        target_frame: str,
        target_time: AnyTime,
        fixed_frame: str,
        timeout: Duration | None = None,
        new_type: type | None = None,
    ) -> Any:
        """A stamped message in `target_frame` at another time; see `transform`.

        Raises:
            TypeException: a message that cannot be transformed or converted.
            TransformException: see `lookup_transform_full`.
        """
        do_transform = self.registration.get(type(object_stamped))
        at = object_stamped.header
        found = self.lookup_transform_full(
            target_frame, target_time, at.frame_id, at.stamp, fixed_frame, timeout or Duration()
        )
        moved = do_transform(object_stamped, found)
        return moved if new_type is None else convert(moved, new_type)

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: AnyTime, timeout: Duration | None = None
    ) -> TransformStamped:
        """The transform that takes points from source to target."""
        raise NotImplementedException

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: AnyTime,
        source_frame: str,
        source_time: AnyTime,
        fixed_frame: str,
        timeout: Duration | None = None,
    ) -> TransformStamped:
        """From source at one time to target at another, through a frame that stands still."""
        raise NotImplementedException

    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: AnyTime,
        timeout: Duration | None = None,
        return_debug_tuple: bool = False,
    ) -> bool | tuple[bool, str]:
        """Whether `lookup_transform` would answer; with the reason if `return_debug_tuple`."""
        reason = why_not(lambda: self.lookup_transform(target_frame, source_frame, time, timeout))
        return (not reason, reason) if return_debug_tuple else not reason

    def can_transform_full(
        self,
        target_frame: str,
        target_time: AnyTime,
        source_frame: str,
        source_time: AnyTime,
        fixed_frame: str,
        timeout: Duration | None = None,
        return_debug_tuple: bool = False,
    ) -> bool | tuple[bool, str]:
        """Whether `lookup_transform_full` would answer; see `can_transform`."""
        reason = why_not(
            lambda: self.lookup_transform_full(
                target_frame, target_time, source_frame, source_time, fixed_frame, timeout
            )
        )
        return (not reason, reason) if return_debug_tuple else not reason


def why_not(lookup: Callable[[], object]) -> str:
    """Return why a lookup is not answered; empty if it is."""
    try:
        lookup()
    except TransformException as error:
        return str(error)
    return ""


def _registered(table: dict[Any, Callable[[Any], Any]], key: Any) -> Callable[[Any], Any]:
    if key not in table:
        raise TypeException(f"nobody registered how to convert {key}")
    return table[key]
