"""What the page sees of a robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, NamedTuple

from head_tracking.transforms import (
    RobotModel,
    Transform,
    TransformBuffer,
    TransformException,
    Vector3,
)


class Outcome(NamedTuple):
    """How a request ended: whether it was done, and a sentence for the person who asked."""

    done: bool
    text: str


class Hold:
    """Why nothing is commanded from the page for the time being; STOP and Resume are.

    Attributes:
        reason: for the person who wants something; empty: everything may be commanded.
    """

    reason = ""


@dataclass(frozen=True, slots=True)
class Observation:
    """The robot at one moment.

    Attributes:
        stamp: when [ns].
        joints: position of every joint that is known [rad or m].
        frames: frames outside the model, each as the transform into the model's root.
        target: where the head is to look, in the model's root [m]; None without a target.
        target_text: the target as it was sent.
        error: angle by which the head misses the target [rad].
        state: what the node that turns the head says of itself.
        target_stamp: when the target was there [ns]; None: at `stamp`.
        silent_joints: joints of the head of which nothing is heard, though somebody should tell.
        missing_nodes: nodes that should turn the head, or send it targets, and have gone.
    """

    stamp: int
    joints: Mapping[str, float] = field(default_factory=dict)
    frames: Mapping[str, Transform] = field(default_factory=dict)
    target: Vector3 | None = None
    target_text: str = ""
    error: float | None = None
    state: str = ""
    target_stamp: int | None = None
    silent_joints: tuple[str, ...] = ()
    missing_nodes: tuple[str, ...] = ()


def outer_frames(buffer: TransformBuffer, model: RobotModel) -> Mapping[str, Transform]:
    """The newest transforms into the model's root, of all frames that are not the model's."""
    found = {}
    for frame in buffer.frames():
        if frame not in model.children_of_joints and frame != model.root:
            try:
                found[frame] = buffer.lookup_transform(model.root, frame).transform
            except TransformException:
                continue
    return found


class Level(IntEnum):
    """How bad it is, as in diagnostic_msgs."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class Health:
    """What one part of the robot says of itself on /diagnostics."""

    name: str
    level: Level
    message: str
    values: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Setting:
    """A parameter of a node that can be changed while it runs.

    Attributes:
        node: whose.
        name: its name.
        value: a bool, int, float, str, or list of floats.
        description: what it does, and its unit.
        minimum: smallest number that its node takes; -inf if it does not say.
        maximum: largest number.
        choices: the words that its node takes; empty for any.
    """

    node: str
    name: str
    value: Any
    description: str
    minimum: float
    maximum: float
    choices: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Servo:
    """A joint that a servo turns.

    Attributes:
        controller: its name on the bus.
        joint: the joint; empty while it is not known.
        torque: whether it holds; None if that is not known.
        refuses: whether it takes no commands before its torque is switched on.
    """

    controller: str
    joint: str
    torque: bool | None
    refuses: bool = False
