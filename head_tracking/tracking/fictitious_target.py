"""The target of the tutorial: a point that oscillates in front of the robot."""

from __future__ import annotations

import math
from dataclasses import dataclass

from head_tracking.parameters import ParameterError, parameter
from head_tracking.transforms import Vector3

_MOST_PERIODS = 100.0  # of motion in one call, after a pause or a jump of the clock


@dataclass(frozen=True, slots=True)
class FictitiousTargetParameters:
    """The path x, y, z = centre + amplitude * (sin t, sin t, h); defaults: the tutorial's.

    h is |sin t|, whose velocity jumps where it is 0, or sin^2 t, whose velocity does not.
    """

    center: tuple[float, ...] = parameter(
        (0.5, 0.0, -0.1), "Middle of the path: x, y, z.", unit="m", minimum=-1e3, maximum=1e3
    )
    amplitude: tuple[float, ...] = parameter(
        (0.25, 0.5, 0.5),
        "Swing in x, y and z; all 0: the target stands still.",
        unit="m",
        minimum=-1e3,
        maximum=1e3,
    )
    path: str = parameter(
        "tutorial",
        "How the height swings: |sin t| as in the tutorial, or harmonic, without a jerk: sin^2 t.",
        choices=("tutorial", "harmonic"),
    )
    step: float = parameter(
        0.025,
        "How far t advances from one message to the next, if that is in time.",
        unit="rad",
        minimum=0.0,
        maximum=3.0,
    )

    def __post_init__(self) -> None:
        for name in ("center", "amplitude"):
            if len(getattr(self, name)) != 3:
                raise ParameterError(f"{name} is {list(getattr(self, name))}; it needs x, y and z")


class FictitiousTarget:
    """The point on its path; `parameters` may change at any time."""

    def __init__(self, parameters: FictitiousTargetParameters) -> None:
        self.parameters = parameters
        self._t = 0.0

    def advance(self, periods: float = 1.0) -> Vector3:
        """Move on and return the point, shape (3,) [m].

        Args:
            periods: the time since the last call over the nominal one. A message that is late is
                farther along the path, so that stamps and points agree.
        """
        p = self.parameters
        self._t += p.step * min(max(periods, 0.0), _MOST_PERIODS)
        sine = math.sin(self._t)
        x, y, z = p.center
        dx, dy, dz = p.amplitude
        height = sine * sine if p.path == "harmonic" else abs(sine)
        return x + dx * sine, y + dy * sine, z + dz * height
