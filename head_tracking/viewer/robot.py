"""What the page sees of a robot, and what it can ask of it. The node behind it knows ROS."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from typing import Any, NamedTuple, Protocol

from head_tracking.gaze import PanTiltHead
from head_tracking.transforms import RobotModel, Transform, Vector3


class Outcome(NamedTuple):
    """How a request ended: whether it was done, and a sentence for the person who asked."""

    done: bool
    text: str


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
        state: what the tracker says of itself.
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


class Mode(StrEnum):
    """What decides where the head looks."""

    POINT = "point"
    TRACK = "track"
    FICTITIOUS = "fictitious target"
    FOLLOW = "follow a frame"


class Robot(Protocol):
    """A running robot. All methods may be called from any thread; requests may take seconds."""

    def model(self) -> RobotModel | None:
        """The robot's model, once it is known; another object when it changes."""

    def head(self) -> PanTiltHead | None:
        """The head that is turned; None if the model has none."""

    def notices(self) -> tuple[str, ...]:
        """What a person should know of the set-up."""

    def frames(self) -> tuple[str, ...]:
        """Names of all frames that can be looked up now."""

    def observe(self) -> Observation:
        """The robot now."""

    def health(self) -> tuple[Health, ...]:
        """The newest diagnostics, by name."""

    def warnings(self) -> tuple[str, ...]:
        """What nodes warned of, newest last."""

    def can_recover(self) -> bool:
        """Whether faults of servos can be cleared."""

    def servos(self) -> tuple[Servo, ...]:
        """The servos that can be switched."""

    def settings(self) -> tuple[Setting, ...]:
        """Parameters that can be changed while their nodes run."""

    def images(self) -> tuple[str, ...]:
        """Topics with pictures."""

    def picture(self, topic: str) -> Any:
        """The newest picture of a topic, shape (height, width, 3), uint8; None without one."""

    def can_start_camera(self) -> bool:
        """Whether a camera can be simulated and is not yet."""

    def start_camera(self) -> Outcome:
        """Simulates a camera; its pictures come on a topic."""

    def mode(self) -> Mode | None:
        """What decides where the head looks; None if nothing that is known here does."""

    def tracking(self) -> bool | None:
        """Whether the tracker turns the head; None if there is no tracker."""

    def free_joints(self) -> bool:
        """Whether nobody measures or states the joints, so that the page may."""

    def look_at(self, frame: str, point: Vector3) -> Outcome:
        """Sends a target [m]."""

    def centre(self) -> Outcome:
        """Turns the head to the middle."""

    def set_mode(self, mode: Mode, frame: str) -> Outcome:
        """Lets something else decide where the head looks; `frame` is the one to follow."""

    def set_tracking(self, on: bool) -> Outcome:
        """Switches the tracker on or off."""

    def set_value(self, node: str, name: str, value: Any) -> Outcome:
        """Sets a parameter."""

    def move_joints(self, positions: Mapping[str, float]) -> Outcome:
        """Moves joints, all in one command [rad or m]."""

    def set_torque(self, controller: str, on: bool) -> Outcome:
        """Lets a servo hold or go; all of them for an empty name."""

    def recover(self) -> Outcome:
        """Clears the faults of servos."""

    def stop(self) -> Outcome:
        """Relaxes everything at once."""
