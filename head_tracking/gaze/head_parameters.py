"""Which joints make up a head, how far they go, and what targets wait for."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import copysign, inf

from head_tracking.gaze.pan_tilt_head import PanTiltHead
from head_tracking.parameters import parameter
from head_tracking.transforms import RobotModel, RobotModelError

Limits = tuple[tuple[float, float], tuple[float, float]]
"""Lower and upper limits of pan and tilt [rad]."""

_WIDEST = 10.0  # rad
_NARROWS = "Narrows the model's limit; 10 or -10: does not."


@dataclass(frozen=True, slots=True)
class HeadParameters:
    """Which joints and frame make up the head, and how far the joints go."""

    head_pan_joint: str = parameter(
        "head_pan_joint", "The joint that turns the head left and right.", fixed=True
    )
    head_tilt_joint: str = parameter(
        "head_tilt_joint", "The joint that turns it up and down.", fixed=True
    )
    pointing_frame: str = parameter("camera_link", "The frame to point.", fixed=True)
    camera_link: str = parameter("", "Former name of `pointing_frame`; has priority.", fixed=True)
    pointing_axis: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0),
        "The direction in the pointed frame to point; 0 0 0: z of an optical frame, else x.",
        fixed=True,
    )
    min_pan: float = parameter(-10.0, _NARROWS, unit="rad", minimum=-10.0, maximum=10.0, fixed=True)
    max_pan: float = parameter(10.0, _NARROWS, unit="rad", minimum=-10.0, maximum=10.0, fixed=True)
    min_tilt: float = parameter(
        -10.0, _NARROWS, unit="rad", minimum=-10.0, maximum=10.0, fixed=True
    )
    max_tilt: float = parameter(10.0, _NARROWS, unit="rad", minimum=-10.0, maximum=10.0, fixed=True)
    fixed_frame: str = parameter(
        "",
        "The frame that stands still: targets are placed and their motion is estimated in it. "
        "Empty: the link that carries the pan joint; odom or map for a robot that drives.",
        fixed=True,
    )
    transform_timeout: float = parameter(
        1.0,
        "How long a target waits for its frame or for the joint states of its time.",
        unit="s",
        minimum=0.0,
        maximum=60.0,
        fixed=True,
    )
    target_latency: float = parameter(
        0.0,
        "Targets are so much older than their stamps say, as of a camera that stamps late.",
        unit="s",
        minimum=-1.0,
        maximum=1.0,
        fixed=True,
    )
    joint_state_timeout: float = parameter(
        0.5,
        "Without joint states for so long the head is left alone.",
        unit="s",
        minimum=0.05,
        maximum=60.0,
        fixed=True,
    )

    @property
    def pointed(self) -> str:
        """The frame to point, whichever of its two parameters names it."""
        return self.camera_link or self.pointing_frame

    @property
    def limits(self) -> Limits:
        """How far pan and tilt may go [rad]; infinite where that is not narrowed."""
        lower, upper = (
            [copysign(inf, limit) if abs(limit) == _WIDEST else limit for limit in limits]
            for limits in ((self.min_pan, self.min_tilt), (self.max_pan, self.max_tilt))
        )
        return (lower[0], upper[0]), (lower[1], upper[1])

    def within(self, pan: tuple[float, float], tilt: tuple[float, float]) -> HeadParameters:
        """Return the same parameters with limits narrowed to those of pan and tilt [rad]."""
        own_pan, own_tilt = self.limits
        return replace(
            self,
            min_pan=max(own_pan[0], pan[0]),
            max_pan=min(own_pan[1], pan[1]),
            min_tilt=max(own_tilt[0], tilt[0]),
            max_tilt=min(own_tilt[1], tilt[1]),
        )

    def head(
        self, model: RobotModel, frame: str = "", axis: tuple[float, ...] | None = None
    ) -> PanTiltHead:
        """Return the head of a robot.

        Args:
            model: of the robot.
            frame: the frame to point; empty: that of the parameters.
            axis: the direction in it to point; None: `pointing_axis`.

        Raises:
            RobotModelError: the model has no such head.
        """
        axis = self.pointing_axis if axis is None else axis
        pan, tilt = self.head_pan_joint, self.head_tilt_joint
        try:
            return PanTiltHead(
                model,
                pan,
                tilt,
                frame or self.pointed,
                axis if any(axis) else None,
                *self.limits,
            )
        except RobotModelError as error:
            if {pan, tilt} <= model.joints.keys() and (frame or self.pointed in model.links):
                raise
            raise RobotModelError(
                f"{error}; set head_pan_joint, head_tilt_joint and pointing_frame to the names of "
                "your model, for example in a YAML file beside it"
            ) from error
