"""Observations of a robot over time."""

from __future__ import annotations

import bisect
from collections.abc import Mapping
from dataclasses import dataclass, field
from operator import itemgetter
from typing import NamedTuple

from head_tracking.ros.targets.latest_target import TransformedTarget
from head_tracking.transforms import RobotModel, TransformBuffer, Vector3

_PICTURE_AGE = _TARGET_AGE = 2_000_000_000  # ns
ERRORS = {"head_tracker": "head_tracker/tracking_error", "point_head": "point_head/pointing_error"}
"""The topic on which each controller publishes its error."""


class RecordingError(ValueError):
    """There is no recording, or a file is invalid."""


@dataclass(frozen=True, slots=True)
class Observation:
    """The robot at one moment.

    Attributes:
        stamp: when [ns].
        joints: the known joint positions [rad or m].
        target: the target in the model's root [m]; None: there is none.
        target_text: the target as it was sent.
        error: angle by which the head misses the target [rad].
        controller: the node that controls the head; empty: none.
        state: the state that it publishes; `stopped` if a recording has a STOP.
        detail: the reason for the state.
        refusal: why the latest target is refused; empty: it is not.
        target_stamp: when the target was there [ns]; None: not known.
    """

    stamp: int
    joints: Mapping[str, float] = field(default_factory=dict)
    target: Vector3 | None = None
    target_text: str = ""
    error: float | None = None
    controller: str = ""
    state: str = ""
    detail: str = ""
    refusal: str = ""
    target_stamp: int | None = None

    @property
    def text(self) -> str:
        """Controller, state, and the reason for it."""
        return ": ".join(filter(None, (self.controller, self.state, self.refusal or self.detail)))


def observed(
    now: int,
    buffer: TransformBuffer,
    model: RobotModel,
    target: TransformedTarget | None,
    error: float | None,
    controller: str,
    status: Mapping[str, str],
) -> Observation:
    """Return the robot at a moment.

    The controller's status has whether there is a target. Without that, an old one is left out, and
    so is one that `point_head` refuses: it keeps the target before.

    For the arguments see `Observation`; `status` has the fields of the controller's `~/status`.
    """
    is_recent = target is not None and abs(now - target.stamp) <= _TARGET_AGE
    has_target = status.get("target", "true" if is_recent else "false") == "true"
    if controller == "point_head" and status.get("refusal"):
        has_target = False
    sent, point, stamp = target if target is not None and has_target else ("", None, None)
    return Observation(
        now,
        known_joints(buffer, model),
        point,
        str(sent),
        error,
        controller,
        status.get("state", ""),
        status.get("detail", ""),
        status.get("refusal", ""),
        stamp,
    )


def known_joints(buffer: TransformBuffer, model: RobotModel) -> dict[str, float]:
    """Return the latest position of every joint that is known [rad or m]."""
    found = {name: buffer.latest_joint_position(name) for name in model.independent_joints}
    return {name: latest[1] for name, latest in found.items() if latest is not None}


class Moment(NamedTuple):
    """An event, such as a STOP or a fault.

    Attributes:
        time: from the start of the recording [s].
        text: what happened.
    """

    time: float
    text: str


@dataclass(frozen=True, slots=True)
class Recording:
    """Observations of a robot, oldest first; at least one.

    Attributes:
        seen: the observations.
        model: the robot's model.
        moments: events, oldest first.
        notice: what is unusual about the recording; empty: nothing.
        pictures: of one camera, oldest first: stamp [ns], and JPEG or PNG.
    """

    seen: tuple[Observation, ...]
    model: RobotModel
    moments: tuple[Moment, ...] = ()
    notice: str = ""
    pictures: tuple[tuple[int, bytes], ...] = ()

    @property
    def duration(self) -> float:
        """From the first to the last observation [s]."""
        return (self.seen[-1].stamp - self.seen[0].stamp) * 1e-9

    def at(self, time: float) -> Observation:
        """Return the observation at, or last before, a time [s] from the start."""
        stamp = self.seen[0].stamp + round(time * 1e9)
        index = bisect.bisect_right(self.seen, stamp, key=lambda one: one.stamp)
        return self.seen[max(0, index - 1)]

    def picture_at(self, time: float) -> bytes | None:
        """Return the latest picture before a time [s] from the start; None without a recent one.

        Before the first picture it is the first one.
        """
        stamp = self.seen[0].stamp + round(time * 1e9)
        if not self.pictures:
            return None
        index = bisect.bisect_right(self.pictures, stamp, key=itemgetter(0))
        taken, picture = self.pictures[max(0, index - 1)]
        return picture if abs(stamp - taken) <= _PICTURE_AGE else None
