"""Refining a gaze on heads whose axes are not square to each other."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from head_tracking.gaze.geometry import HeadGeometry, turned
from head_tracking.transforms import JointLimits, Vector3

_EXACT = 1e-13  # rad
_MAX_STEPS = 50
_MAX_HALVINGS = 12

_Vector = npt.NDArray[np.float64]


def refine(
    geometry: HeadGeometry,
    point: Vector3,
    start: tuple[float, float],
    limits: tuple[JointLimits, JointLimits],
) -> tuple[float, float]:
    """Pan and tilt [rad] inside the limits that miss `point` least, near `start`.

    Damped Newton on the two components of the direction to the point that are square to the
    pointing axis; a step that does not come nearer is halved.

    Args:
        geometry: the head.
        point: shape (3,) [m], in C.
        start: pan and tilt to start from [rad].
        limits: of pan and of tilt.
    """
    across = _across(np.array(geometry.axis))
    positions = np.array([limit.clamp(p) for limit, p in zip(limits, start, strict=True)])
    miss = geometry.miss(point, *positions)
    for _ in range(_MAX_STEPS):
        if miss < _EXACT:
            break
        residual, jacobian = _linearised(geometry, point, positions, across)
        step = _step_inside(jacobian, residual, positions, limits)
        for _ in range(_MAX_HALVINGS):
            trial = np.array(
                [limit.clamp(p) for limit, p in zip(limits, positions + step, strict=True)]
            )
            trial_miss = geometry.miss(point, *trial)
            if trial_miss < miss:
                break
            step = 0.5 * step
        else:
            break
        positions, miss = trial, trial_miss
    return float(positions[0]), float(positions[1])


def _linearised(
    geometry: HeadGeometry, point: Vector3, positions: _Vector, across: _Vector
) -> tuple[_Vector, _Vector]:
    """How far the direction is off, shape (2,), and its change per joint, shape (2, 2)."""
    pan, tilt = positions
    seen = np.array(geometry.seen(point, pan, tilt))
    x, y, _ = turned(point, pan)
    axis = np.array(geometry.tilt_axis)
    by_pan = _back(axis, tilt) @ np.array([y, -x, 0.0])
    by_tilt = -np.cross(axis, seen + np.array(geometry.camera))
    distance = float(np.linalg.norm(seen))
    direction = seen / distance
    # the sine of the angle is a residual that vanishes behind the head as well: use the angle
    residual = across @ direction
    sine = float(np.linalg.norm(residual))
    angle = math.atan2(sine, float(direction @ np.array(geometry.axis)))
    motions = [across @ (m - (m @ direction) * direction) / distance for m in (by_pan, by_tilt)]
    scale = angle / sine if sine > 1e-9 else 1.0
    return residual * scale, np.column_stack(motions)


def _step_inside(
    jacobian: _Vector,
    residual: _Vector,
    positions: _Vector,
    limits: tuple[JointLimits, JointLimits],
) -> _Vector:
    """The Newton step; a joint that stands on its limit and would leave it takes no part."""
    step = np.linalg.lstsq(jacobian, -residual, rcond=1e-9)[0]
    free = [
        limit.contains(position + math.copysign(1e-9, change))
        for limit, position, change in zip(limits, positions, step, strict=True)
    ]
    if not all(free):
        step = np.zeros(2)
        if any(free):
            step[free] = np.linalg.lstsq(jacobian[:, free], -residual, rcond=1e-9)[0]
    return np.clip(step, -1.0, 1.0)


def _back(axis: _Vector, angle: float) -> _Vector:
    """The rotation by `-angle` about `axis`, shape (3, 3)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(
        np.eye(3) - math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)
    )


def _across(axis: _Vector) -> _Vector:
    """Two unit vectors square to `axis` and to each other, shape (2, 3)."""
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first)])
