"""Targets and trackers of the closed-loop tests."""

import math
from collections.abc import Callable
from typing import Any

from closed_loop import ClosedLoop, Conditions, Outcome, Path, kinectbot

from head_tracking.gaze import PanTiltHead
from head_tracking.tracking import LAWS, Tracker, TrackingStep
from head_tracking.transforms import Vector3

LEVEL = 0.08  # m above the head's base frame
HEAD = PanTiltHead(
    kinectbot(), "head_pan_joint", "head_tilt_joint", "camera_link", tilt_limits=(-1.08, 1.47)
)
BESIDE = Conditions(duration=16.0, noise=0.002, delay=0.05, field=(3.0, 3.0))
ON_HEAD = Conditions(duration=10.0, noise=0.002, delay=0.1, on_head=True)


def around(bearing: float, level: float = LEVEL, distance: float = 2.0) -> Vector3:
    """Return a point in front of the head, at a bearing [rad]."""
    return distance * math.cos(bearing), distance * math.sin(bearing), level


def sine(frequency: float, amplitude: float = 0.5, middle: float = 0.0) -> Path:
    """Return an oscillation [Hz, rad]."""
    return lambda t: around(middle + amplitude * math.sin(math.tau * frequency * t))


def from_rest(frequency: float, level: float = LEVEL) -> Path:
    """Return an oscillation that begins at rest and comes to its speed within 2 s [Hz]."""
    return lambda t: around(
        0.5 * math.sin(math.tau * frequency * (0.25 * t * t if t < 2.0 else t - 1.0)), level
    )


swing = sine(0.2)


def still(t: float) -> Vector3:
    return around(0.3)


def stop_and_go(t: float) -> Vector3:
    """Move for 1 s at 0.4 rad/s, stand for 1 s, and back."""
    phase = t % 4.0
    return around(0.4 * (min(phase, 1.0) - min(max(phase - 2.0, 0.0), 1.0)))


def circle(t: float) -> Vector3:
    return around(0.4 * math.sin(1.5 * t), 0.2 + 0.2 * math.cos(1.5 * t))


def tracker(law: str = "predictive", rate: float = 50.0, **others: Any) -> Tracker:
    """Return a tracker of `HEAD`; `others` are arguments of its law."""
    return Tracker(HEAD, LAWS[law](HEAD, 1.0 / rate, **others))


def run(path: Path, conditions: Conditions, controller: Any = None) -> Outcome:
    """Run a controller, by default a tracker with the law `predictive`."""
    return ClosedLoop(path, conditions).run(controller or tracker(rate=conditions.rate))


class Watched:
    """A tracker that calls `note` with the time and itself after each step."""

    def __init__(self, steered: Tracker, note: Callable[[float, Tracker], object]) -> None:
        self.tracker, self._note = steered, note
        self.joints_read, self.target_seen = steered.joints_read, steered.target_seen

    def step(self, now: float) -> TrackingStep:
        step = self.tracker.step(now)
        self._note(now, self.tracker)
        return step
