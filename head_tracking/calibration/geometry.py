"""Kinematics of a head with calibration errors."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from head_tracking.gaze import PanTiltHead
from head_tracking.transforms import Joint, RobotModel, Rotation, Transform

Array = npt.NDArray[np.float64]

_DEGREE: Final = math.pi / 180.0


class Parameter(NamedTuple):
    """A calibration parameter.

    Attributes:
        name: name in the result.
        unit: rad, m, or empty for a ratio.
        prior: standard deviation of the prior, with mean 0.
    """

    name: str
    unit: str
    prior: float

    def displayed(self, value: float) -> tuple[float, str]:
        """Convert a value to degrees, mm or %; return it with its unit."""
        scale, unit = {"rad": (180.0 / math.pi, "degrees"), "m": (1e3, "mm")}.get(
            self.unit, (100.0, "%")
        )
        return scale * value, unit


AHEAD: Final = (0.0, 0.0, 1.0)
"""The axis of an optical frame along which its camera looks."""

PARAMETERS: Final = (
    Parameter("camera pitch", "rad", 5 * _DEGREE),
    Parameter("camera yaw", "rad", 5 * _DEGREE),
    Parameter("camera roll", "rad", 5 * _DEGREE),
    Parameter("camera to the right", "m", 0.01),
    Parameter("camera down", "m", 0.01),
    Parameter("camera ahead", "m", 0.01),
    Parameter("tilt axis not square", "rad", 2 * _DEGREE),
    Parameter("focal length", "", 0.05),
    Parameter("tilt zero", "rad", 3 * _DEGREE),
    Parameter("pan zero", "rad", 3 * _DEGREE),
    Parameter("tilt play", "rad", 1 * _DEGREE),
    Parameter("pan play", "rad", 1 * _DEGREE),
)
"""Parameters by priority: of two that a scene cannot distinguish, the later one is not estimated.

The camera is rotated about the axes of its optical frame, x (pitch), y (yaw) and z (roll), and
moved along x (right), y (down) and z (ahead). The tilt axis is rotated towards the pan axis. `focal
length` is the logarithm of a factor. Play is from side to side, between encoder and camera: the
camera lags behind the encoder by half of it.
"""
FOCAL_LENGTH: Final = 7
TILT_PLAY: Final = 10
PAN_PLAY: Final = 11
ZEROS: Final = (8, 9)
"""Joint zeros. One that is not observable is that of the model, by definition."""


class Estimate(NamedTuple):
    """Estimate of a parameter.

    Attributes:
        value: difference from the model [rad, m, or a ratio]; 0 if it is not observable.
        deviation: standard deviation.
        observable: whether the views determine it.
    """

    value: float
    deviation: float
    observable: bool


class Residuals(NamedTuple):
    """Where the camera sees the corners or points, and where they are expected.

    Attributes:
        focal: focal length [px].
        seen: in the images, relative to the optical axis, shape (N, 2) [px].
        before: by how much the model's expectation differs, shape (N, 2) [px].
        after: by how much the calibrated model's expectation differs, shape (N, 2) [px].
    """

    focal: float
    seen: Array
    before: Array
    after: Array

    def errors(self) -> tuple[float, float]:
        """Return the rms errors of direction before and after the calibration [rad]."""
        before, after = (
            float(np.sqrt((each**2).sum(axis=1).mean())) / self.focal
            for each in (self.before, self.after)
        )
        return before, after


class HeadGeometry:
    """Kinematic chain from the base of a head to its camera.

    Args:
        model: model of the robot.
        pan_joint: name of the pan joint.
        tilt_joint: name of the tilt joint.
        optical_frame: optical frame of the camera.

    Attributes:
        model: model of the robot.
        base: parent link of the pan joint.
        pan: the pan joint.
        tilt: the tilt joint.
        optical_frame: optical frame of the camera.

    Raises:
        RobotModelError: the joints do not carry the frame, or one does not carry the other.
    """

    def __init__(
        self, model: RobotModel, pan_joint: str, tilt_joint: str, optical_frame: str
    ) -> None:
        self.base = PanTiltHead(model, pan_joint, tilt_joint, optical_frame, AHEAD).base_frame
        self.model, self.optical_frame = model, optical_frame
        self.pan, self.tilt = pan, tilt = model.joint(pan_joint), model.joint(tilt_joint)
        self._camera = _camera_joint(model, optical_frame, tilt.child)
        self._before_pan = _parts(pan.origin)
        self._before_tilt = _parts(model.transform(pan.child, tilt.parent, {}) @ tilt.origin)
        self._before_camera = _parts(model.transform(tilt.child, optical_frame, {}))

    def cameras(self, changes: Array, pans: Array, tilts: Array) -> tuple[Array, Array]:
        """Return the poses of the camera, `T_base_optical`, in several views.

        Args:
            changes: values of `PARAMETERS`, shape (12,); play is ignored.
            pans: positions of the pan joint, shape (N,) [rad].
            tilts: positions of the tilt joint, shape (N,) [rad].

        Returns:
            Rotations, shape (N, 3, 3), and positions, shape (N, 3) [m].
        """
        turn, shift = rotation_matrices(changes[None, 0:3])[0], changes[3:6]
        camera, at = self._before_camera
        camera, at = camera @ turn, at + camera @ shift
        tilting = rotation_matrices(np.outer(tilts + changes[8], self._tilt_axis(changes[6])))
        tilted, pivot = self._before_tilt
        rotations, positions = tilted @ tilting @ camera, pivot + tilting @ at @ tilted.T
        panned, root = self._before_pan
        panning = panned @ rotation_matrices(np.outer(pans + changes[9], self.pan.axis))
        return panning @ rotations, root + np.einsum("nij,nj->ni", panning, positions)

    def changed(self, changes: Array) -> dict[str, Joint]:
        """Return the changed joints of the model; see `cameras`."""
        joints = {}
        if changes[:6].any():
            joint = self._camera
            rest = self.model.transform(joint.child, self.optical_frame, {})
            turn = Rotation.from_matrix(rotation_matrices(changes[None, 0:3])[0])
            right, down, ahead = changes[3:6].tolist()
            delta = Transform((right, down, ahead), turn)
            origin = joint.origin @ rest @ delta @ rest.inverse()
            joints[joint.name] = replace(joint, origin=origin)
        pan, tilt = self.pan, self.tilt
        if changes[6] or changes[8]:
            x, y, z = self._tilt_axis(changes[6]).tolist()
            zero = Rotation.from_axis_angle((x, y, z), float(changes[8]))
            origin = tilt.origin @ Transform((0.0, 0.0, 0.0), zero)
            joints[tilt.name] = replace(tilt, axis=(x, y, z), origin=origin)
        if changes[9]:
            joints[pan.name] = replace(pan, origin=pan.transform(float(changes[9])))
        return joints

    def _tilt_axis(self, angle: float) -> Array:
        """Return the tilt axis in the frame of its joint, rotated towards the pan axis [rad]."""
        axis = np.array(self.tilt.axis)
        pan = np.array(self.pan.axis) @ self._before_tilt[0]
        towards = pan - axis * (pan @ axis)
        towards /= np.linalg.norm(towards)
        return np.asarray(math.cos(angle) * axis + math.sin(angle) * towards)


def rotation_matrices(vectors: Array) -> Array:
    """Convert rotation vectors, shape (N, 3) [rad], to matrices, shape (N, 3, 3)."""
    from scipy.spatial.transform import Rotation as Rotations  # takes 0.2 s

    return np.asarray(Rotations.from_rotvec(vectors).as_matrix())


def _camera_joint(model: RobotModel, optical_frame: str, tilted: str) -> Joint:
    """Return the fixed joint that carries the camera, not one that only rotates its axes."""
    joint = model.parent_joint(optical_frame)
    assert joint is not None  # the tilt joint carries it
    above = model.parent_joint(joint.parent)
    turns_only = not any(joint.origin[:3])
    if turns_only and joint.parent != tilted and above is not None:
        return above
    return joint


def _parts(transform: Transform) -> tuple[Array, Array]:
    matrix = transform.as_matrix()
    return matrix[:3, :3], matrix[:3, 3]
