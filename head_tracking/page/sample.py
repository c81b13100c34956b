"""What a browser is shown of one observation."""

from __future__ import annotations

import math
from typing import Any

from head_tracking.gaze import PanTiltHead
from head_tracking.page.gaze_lines import wanted_gaze
from head_tracking.recording.recording import Observation
from head_tracking.transforms import RobotModel


def motion_of(
    live: Observation, model: RobotModel | None, head: PanTiltHead | None
) -> dict[str, Any]:
    """Return joints, target and error of an observation for JSON [rad, m, s]."""
    names = () if model is None else model.independent_joints
    return {
        "stamp": live.stamp * 1e-9,
        "joints": [number(live.joints.get(name)) for name in names],
        "target": None if live.target is None else list(map(number, live.target)),
        "error": number(live.error),
        "wanted": list(map(number, wanted_gaze(model, head, live))),
    }


def number(value: float | None) -> float | None:
    """Return a number for JSON; None for none and for those that are not finite."""
    return None if value is None or not math.isfinite(value) else round(float(value), 6)
