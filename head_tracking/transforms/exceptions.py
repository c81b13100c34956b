"""Errors of lookups, with the names of tf2, and of robot models."""

from head_tracking.exceptions import HeadTrackingError


class TransformException(HeadTrackingError):
    """Base class of all errors of lookups."""


class LookupException(TransformException):
    """A frame is unknown, or a joint on the path has no position yet."""


class ConnectivityException(TransformException):
    """Both frames are known, but they are in different trees."""


class ExtrapolationException(TransformException):
    """The time is outside of the recorded history."""


class InvalidArgumentException(TransformException):
    """An argument is not valid: NaN, an empty frame name, and others."""


class TimeoutException(TransformException):
    """The transform did not become available in time."""


class RobotModelError(HeadTrackingError):
    """A robot model is not valid; the message names the element."""
