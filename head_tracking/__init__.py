"""Point a pan/tilt head at targets: servos, transforms, gaze and tracking.

`from head_tracking import Head` is for Python programs; see `head_tracking.head.head`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from head_tracking.head.head import (
        FrameError,
        Head,
        HeadState,
        HeadTrackingError,
        JointConfiguration,
        PointingResult,
        RefusedCommandError,
        SupersededError,
        TargetState,
        UnreachableError,
    )

__all__ = [
    "FrameError",
    "Head",
    "HeadState",
    "HeadTrackingError",
    "JointConfiguration",
    "PointingResult",
    "RefusedCommandError",
    "SupersededError",
    "TargetState",
    "UnreachableError",
]


def __getattr__(name: str) -> Any:
    """Load `Head` and what belongs to it when a program asks for it: no node needs it."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from head_tracking.head import head

    return getattr(head, name)
