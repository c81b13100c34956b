"""The geometry of a pan/tilt head, taken from its model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from head_tracking.transforms import (
    Joint,
    JointType,
    RobotModel,
    RobotModelError,
    Rotation,
    Transform,
    Vector3,
)

_SQUARE = 1e-12


@dataclass(frozen=True, slots=True)
class HeadGeometry:
    """Where the axes of a head and its camera are.

    All of it is given in one frame, here called C: its origin lies on the pan axis, z points
    along the pan axis, and at pan 0 and tilt 0, y points along the tilt axis as far as that is
    square to z. So pan turns about z and tilt about y, whatever axes and signs the model has.

    Attributes:
        T_C_base: takes points from the link that carries the pan joint into C.
        tilt_axis: unit vector about which tilt turns; y on nearly every head.
        tilt_origin: a point on the tilt axis at pan 0 [m].
        camera: the pointing frame's origin at pan 0 and tilt 0, from `tilt_origin` [m].
        axis: unit vector to point, at pan 0 and tilt 0.
    """

    T_C_base: Transform
    tilt_axis: Vector3
    tilt_origin: Vector3
    camera: Vector3
    axis: Vector3

    @staticmethod
    def from_model(
        model: RobotModel,
        pan: Joint,
        tilt: Joint,
        pointing_frame: str,
        pointing_axis: Sequence[float] | None,
    ) -> HeadGeometry:
        """The geometry of the head that these two joints and this frame make.

        Raises:
            RobotModelError: they do not carry each other, something else moves between them, or
                no direction can be pointed.
        """
        for joint in (pan, tilt):
            if joint.type not in (JointType.REVOLUTE, JointType.CONTINUOUS) or joint.mimic:
                raise RobotModelError(
                    f"{joint.name!r} cannot turn the head: it must be revolute or continuous and "
                    "mimic no other joint"
                )
        below_pan, below_tilt = _fixed_joints(model, pan, tilt, pointing_frame)
        T_pan_tilt = _product(below_pan) @ tilt.origin
        T_tilt_camera = _product(below_tilt)
        tilt_axis = T_pan_tilt.rotation @ tilt.axis
        R_C_pan = _canonical(pan, tilt, tilt_axis)
        R_C_tilt = R_C_pan @ T_pan_tilt.rotation
        return HeadGeometry(
            T_C_base=Transform((0.0, 0.0, 0.0), R_C_pan) @ pan.origin.inverse(),
            tilt_axis=R_C_pan @ tilt_axis,
            tilt_origin=R_C_pan @ T_pan_tilt.translation,
            camera=R_C_tilt @ T_tilt_camera.translation,
            axis=R_C_tilt
            @ (T_tilt_camera.rotation @ _pointing_axis(pointing_frame, pointing_axis)),
        )

    @property
    def square(self) -> bool:
        """Whether tilt is square to pan and the camera looks square to tilt: closed form."""
        return self.tilt_axis[1] > 1 - _SQUARE and abs(self.axis[1]) < _SQUARE

    def seen(self, point: Vector3, pan: float, tilt: float) -> Vector3:
        """A point of C from the camera, in a frame where the pointing axis is `axis` [m].

        Args:
            point: shape (3,) [m], in C, which does not turn.
            pan: position of the pan joint [rad].
            tilt: position of the tilt joint [rad].
        """
        x, y, z = turned(point, pan)
        ox, oy, oz = self.tilt_origin
        cx, cy, cz = self.camera
        back = Rotation.from_axis_angle(self.tilt_axis, -tilt)
        x, y, z = back.apply((x - ox, y - oy, z - oz))
        return x - cx, y - cy, z - cz

    def ahead(self, pan: float, tilt: float, distance: float) -> Vector3:
        """The point on the pointing axis at a distance [m] from the camera, in the base frame."""
        cx, cy, cz = self.camera
        ax, ay, az = self.axis
        ox, oy, oz = self.tilt_origin
        turn = Rotation.from_axis_angle(self.tilt_axis, tilt)
        x, y, z = turn.apply((cx + distance * ax, cy + distance * ay, cz + distance * az))
        x, y, z = turned((x + ox, y + oy, z + oz), -pan)
        return self.T_C_base.inverse().apply((x, y, z))

    def miss(self, point: Vector3, pan: float, tilt: float) -> float:
        """The angle between the pointing axis and the direction to a point of C [rad]."""
        x, y, z = self.seen(point, pan, tilt)
        ax, ay, az = self.axis
        across = math.hypot(ay * z - az * y, az * x - ax * z, ax * y - ay * x)
        return math.atan2(across, ax * x + ay * y + az * z)


def turned(point: Vector3, pan: float) -> Vector3:
    """A point of C in C as the pan joint carries it."""
    cosine, sine = math.cos(pan), math.sin(pan)
    x, y, z = point
    return cosine * x + sine * y, cosine * y - sine * x, z


def _fixed_joints(
    model: RobotModel, pan: Joint, tilt: Joint, pointing_frame: str
) -> tuple[list[Joint], list[Joint]]:
    """The joints from pan down to tilt, and from tilt down to the pointing frame."""
    if pointing_frame not in model.links:
        raise RobotModelError(
            f"the model {model.name!r} has no link {pointing_frame!r} to point; "
            f"its links are: {', '.join(model.links)}"
        )
    above = model.joints_above(pointing_frame)
    if tilt not in above or pan not in above or above.index(tilt) > above.index(pan):
        carried = [
            link
            for link in model.links
            if tilt in (chain := model.joints_above(link)) and pan in chain
        ]
        raise RobotModelError(
            f"{pointing_frame!r} is not carried by {tilt.name!r} on top of {pan.name!r}; "
            f"frames that are: {', '.join(carried) or 'none'}"
        )
    below_tilt = above[: above.index(tilt)][::-1]
    below_pan = above[above.index(tilt) + 1 : above.index(pan)][::-1]
    for joint in (*below_pan, *below_tilt):
        if joint.moves:
            raise RobotModelError(
                f"the joint {joint.name!r} between {pan.name!r} and {pointing_frame!r} moves too; "
                "choose a pointing frame above it, or make it fixed"
            )
    return below_pan, below_tilt


def _product(joints: list[Joint]) -> Transform:
    product = Transform.identity()
    for joint in joints:
        product = product @ joint.origin
    return product


def _canonical(pan: Joint, tilt: Joint, tilt_axis: Vector3) -> Rotation:
    """`R_C_pan`, from the axes of pan and tilt in the pan joint's frame."""
    z = np.array(pan.axis)
    y = np.array(tilt_axis)
    y = y - (y @ z) * z
    if np.linalg.norm(y) < 1e-6:
        raise RobotModelError(
            f"{pan.name!r} and {tilt.name!r} turn about the same direction: "
            "together they can only point along a circle"
        )
    y /= np.linalg.norm(y)
    return Rotation.from_matrix(np.stack([np.cross(y, z), y, z]))


def _pointing_axis(frame: str, axis: Sequence[float] | None) -> Vector3:
    if axis is None:
        return (0.0, 0.0, 1.0) if "optical" in frame else (1.0, 0.0, 0.0)
    norm = math.hypot(*axis)
    if len(axis) != 3 or not 1e-9 < norm < math.inf:
        raise RobotModelError(
            f"the pointing axis {tuple(axis)} is no direction; give three numbers, not all 0"
        )
    return axis[0] / norm, axis[1] / norm, axis[2] / norm
