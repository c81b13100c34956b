"""The errors of this package that its users can correct."""

from __future__ import annotations

from typing import Any


class HeadTrackingError(Exception):
    """An error that the user can correct; the message says what was wrong and what is allowed.

    Programs print the message only. They print the traceback of any other error.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        """Keep message and attributes on the way to another process."""
        return _restored, (type(self), self.args), self.__dict__


def _restored(kind: type[HeadTrackingError], arguments: tuple[Any, ...]) -> HeadTrackingError:
    return kind.__new__(kind, *arguments)


class RefusedError(HeadTrackingError):
    """A program refuses to start or to continue."""


class FrameError(HeadTrackingError):
    """A frame is unknown, or has no transform at the requested time.

    Attributes:
        frame: its name.
    """

    def __init__(self, frame: str, reason: str) -> None:
        super().__init__(reason)
        self.frame = frame


class UnreachableError(HeadTrackingError):
    """A head cannot look at a point. It does not move.

    Attributes:
        point: the point, shape (3,) [m].
        frame: the frame of the point.
        miss: angle between the point and the nearest possible gaze [rad].
    """

    def __init__(
        self, point: tuple[float, float, float], frame: str, miss: float, reason: str
    ) -> None:
        super().__init__(f"{point} in {frame} cannot be looked at: {reason}")
        self.point, self.frame, self.miss = point, frame, miss


class RefusedCommandError(HeadTrackingError):
    """A head refuses a command, because it is stopped, relaxed or closed.

    Attributes:
        state: "stopped", "relaxed" or "closed".
    """

    def __init__(self, state: str) -> None:
        remedy = "open it again" if state == "closed" else "call resume() first"
        super().__init__(f"the head is {state}; {remedy}")
        self.state = state


class SupersededError(HeadTrackingError):
    """A later command replaced this one before the head arrived.

    Attributes:
        point: the point of the replaced command, shape (3,) [m]; NaN: a camera saw none.
        miss: angle to the point at that time [rad]; None: the turn had not started.
    """

    def __init__(self, point: tuple[float, float, float], miss: float | None) -> None:
        super().__init__(f"looking at {point} was replaced by a later command")
        self.point, self.miss = point, miss
