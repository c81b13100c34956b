"""What all errors have in common whose message is all that a person needs to know."""

from __future__ import annotations


class HeadTrackingError(Exception):
    """Something that a person can mend; the message says what is wrong, what is allowed, or both.

    A program that ends by it prints the message; by any other error, the traceback too.
    """


class RefusedError(HeadTrackingError):
    """A run refuses to start, or to go on, whichever of its nodes has found out why."""


class FrameError(HeadTrackingError):
    """A frame is unknown, or was not known at that time.

    Attributes:
        frame: its name.
    """

    def __init__(self, frame: str, reason: str) -> None:
        super().__init__(reason)
        self.frame = frame


class UnreachableError(HeadTrackingError):
    """A head cannot look at a point; nothing has moved.

    Attributes:
        point: the point, shape (3,) [m].
        frame: the frame that it is given in.
        miss: by how much the nearest gaze would miss it [rad].
    """

    def __init__(
        self, point: tuple[float, float, float], frame: str, miss: float, reason: str
    ) -> None:
        super().__init__(f"{point} in {frame} cannot be looked at: {reason}")
        self.point, self.frame, self.miss = point, frame, miss


class RefusedCommandError(HeadTrackingError):
    """A head is stopped, relaxed or closed, and accepts no command.

    Attributes:
        state: which of them.
    """

    def __init__(self, state: str) -> None:
        cure = "open it again" if state == "closed" else "call resume() first"
        super().__init__(f"the head is {state}; {cure}")
        self.state = state


class SupersededError(HeadTrackingError):
    """A head was given something else to do before it arrived.

    Attributes:
        point: the point that was to be looked at, shape (3,) [m].
        miss: by how much the head missed it then [rad]; None: it had not begun.
    """

    def __init__(self, point: tuple[float, float, float], miss: float | None) -> None:
        super().__init__(f"looking at {point} was superseded by a newer command")
        self.point, self.miss = point, miss
