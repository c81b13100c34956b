"""What the page draws of a head's gaze: the wanted angles, the reachable field, paths."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from head_tracking.gaze import PanTiltHead
from head_tracking.page.path import Path, shaped
from head_tracking.recording.recording import Observation
from head_tracking.transforms import RobotModel, Rotation, Vector3

_MERIDIANS, _PARALLELS, _SMOOTH = 9, 5, 25
_AWAY = 1.0  # m: from the camera to a path


def wanted_gaze(
    model: RobotModel | None, head: PanTiltHead | None, live: Observation
) -> tuple[float | None, float | None]:
    """Return pan and tilt [rad] that look at the target or come nearest; None without one."""
    if model is None or head is None or live.target is None:
        return None, None
    standing = dict.fromkeys(model.independent_joints, 0.0)
    target = model.transform(model.root, head.base_frame, standing).inverse() @ live.target
    positions = (live.joints.get(joint, 0.0) for joint in (head.pan_joint, head.tilt_joint))
    gaze = head.gaze(target, *positions)
    return gaze.pan, gaze.tilt


def reachable_field(model: RobotModel, head: PanTiltHead, radius: float) -> npt.NDArray[np.float64]:
    """Return line segments at `radius` [m] from the camera in the root frame; shape (N, 2, 3)."""
    pan, tilt = (
        (max(limits.lower, -math.pi), min(limits.upper, math.pi))
        for limits in (head.pan_limits, head.tilt_limits)
    )
    chain = model.chain(model.root, head.pointing_frame)
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
    return np.array([(a, b) for line in lines for a, b in pairwise(line)])


def path_ahead(model: RobotModel, head: PanTiltHead, shape: str, size: float) -> Path:
    """Return a path 1 m before the camera as it is with all joints at 0, in the model's root.

    Args:
        model: has the head.
        head: looks along the path.
        shape: a key of `SHAPES`.
        size: half the path's width [m].

    Raises:
        ValueError: there is no such shape, or the size is not positive.
    """
    standing = dict.fromkeys(model.independent_joints, 0.0)
    camera = model.transform(model.root, head.pointing_frame, standing)
    ahead: Vector3 = camera.rotation @ head.pointing_axis
    turn = Rotation.from_rpy(0.0, 0.0, math.atan2(ahead[1], ahead[0]))
    x, y, z = (c + _AWAY * a for c, a in zip(camera.translation, ahead, strict=True))
    return shaped(shape, (x, y, z), turn @ (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), size)
