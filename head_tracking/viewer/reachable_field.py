"""The field that a head can look at, as lines on a sphere around its camera."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from head_tracking.gaze import PanTiltHead
from head_tracking.transforms import RobotModel, Rotation, Vector3

_MERIDIANS, _PARALLELS, _SMOOTH = 9, 5, 25


def reachable_field(model: RobotModel, head: PanTiltHead, radius: float) -> npt.NDArray[np.float64]:
    """Line segments at `radius` [m] from the camera, in the head's base frame; shape (N, 2, 3)."""
    pan, tilt = (
        (max(limits.lower, -math.pi), min(limits.upper, math.pi))
        for limits in (head.pan_limits, head.tilt_limits)
    )
    chain = model.chain(head.base_frame, head.pointing_frame)
    point = tuple(radius * a for a in head.pointing_axis)

    def at(pan_position: float, tilt_position: float) -> Vector3:
        positions = {head.pan_joint: pan_position, head.tilt_joint: tilt_position}
        return chain.transform(*[positions.get(joint, 0.0) for joint in chain.joints]) @ point

    lines = [
        [at(p, t) for t in np.linspace(*tilt, _SMOOTH).tolist()]
        for p in np.linspace(*pan, _MERIDIANS).tolist()
    ] + [
        [at(p, t) for p in np.linspace(*pan, _SMOOTH).tolist()]
        for t in np.linspace(*tilt, _PARALLELS).tolist()
    ]
    segments = [(a, b) for line in lines for a, b in pairwise(line)]
    return np.array(segments)


def with_axis_forward(axis: Vector3) -> Rotation:
    """Turns a camera (z forward, y down; REP 103) so that z is `axis` and x is level, if it can.

    For the axis z this changes nothing: that is an optical frame already.
    """
    forward = np.asarray(axis, float)
    if forward[2] > 0.999999:
        return Rotation.identity()
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right) if np.linalg.norm(right) > 1e-9 else 1.0
    if not right.any():
        right = np.array([0.0, -1.0, 0.0])
    return Rotation.from_matrix(np.column_stack([right, np.cross(forward, right), forward]))
