"""What can be wrong with a transform request or a robot model, in tf2's words."""

from head_tracking.exceptions import HeadTrackingError


class TransformException(HeadTrackingError):
    """Root of all errors of a transform request."""


class LookupException(TransformException):
    """A frame is not known, or nothing is known yet of a joint on the way to it."""


class ConnectivityException(TransformException):
    """Both frames are known, but no chain of transforms connects them."""


class ExtrapolationException(TransformException):
    """The time asked for lies outside the recorded history; nothing is ever extrapolated."""


class InvalidArgumentException(TransformException):
    """The request or the sample itself makes no sense (NaN, an empty frame name, ...)."""


class TimeoutException(TransformException):
    """The transform did not become available in the time allowed."""


class RobotModelError(HeadTrackingError):
    """A robot model that cannot be used; the message names the element and the mend."""
