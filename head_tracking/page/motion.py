"""An observation of the robot, as the browser shows it."""

from __future__ import annotations

import math
from typing import Any

from head_tracking.gaze import PanTiltHead
from head_tracking.recording.recording import Observation
from head_tracking.transforms import RobotModel


class MotionView:
    """Converts observations of a robot for the browser.

    Args:
        model: of the robot.
        head: its head; None: it has none.
    """

    def __init__(self, model: RobotModel, head: PanTiltHead | None) -> None:
        self._names, self._head = model.independent_joints, head
        if head is not None:
            at_zero = dict.fromkeys(self._names, 0.0)
            self._T_base_root = model.transform(model.root, head.base_frame, at_zero).inverse()

    def of(self, live: Observation) -> dict[str, Any]:
        """Return joints, target and wanted joint positions for JSON [rad, m, s]."""
        return {
            "stamp": live.stamp * 1e-9,
            "target_stamp": number(None if live.target_stamp is None else live.target_stamp * 1e-9),
            "joints": [number(live.joints.get(name)) for name in self._names],
            "target": None if live.target is None else list(map(number, live.target)),
            "wanted": list(map(number, self._wanted_gaze(live))),
        }

    def _wanted_gaze(self, live: Observation) -> tuple[float | None, float | None]:
        """Return pan and tilt that look at the target or nearest to it; None without one."""
        head = self._head
        if head is None or live.target is None:
            return None, None
        positions = (live.joints.get(joint, 0.0) for joint in (head.pan_joint, head.tilt_joint))
        gaze = head.gaze(self._T_base_root @ live.target, *positions)
        return gaze.pan, gaze.tilt


def number(value: float | None) -> float | None:
    """Return a number for JSON; None for None and for numbers that are not finite."""
    return None if value is None or not math.isfinite(value) else round(float(value), 6)
