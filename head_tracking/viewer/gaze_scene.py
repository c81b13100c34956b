"""The head's gaze in the 3D scene: target, trail, prediction, line of sight, view cone, field."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import viser

from head_tracking.gaze import PanTiltHead
from head_tracking.parameters import parameter
from head_tracking.transforms import RobotModel, Rotation, Vector3
from head_tracking.viewer.robot_scene import RobotScene, wxyz
from head_tracking.viewer.target_path import TargetPath

_TARGET_COLOUR = (230, 80, 200)
_TRAIL_COLOUR = (190, 110, 200)
_PREDICTION_COLOUR = (250, 160, 40)
_SIGHT_COLOUR = (40, 160, 80)
_FIELD_COLOUR = (120, 150, 220)

_CONE = 0.36  # m: from the camera to the picture in its view cone
_LEGEND = {
    "target": (_TARGET_COLOUR, "target"),
    "trail": (_TRAIL_COLOUR, "where it was"),
    "prediction": (_PREDICTION_COLOUR, "where the tracker expects it"),
    "line of sight": (_SIGHT_COLOUR, "what the camera looks along"),
    "reachable field": (_FIELD_COLOUR, "what the head can reach"),
}


@dataclass(frozen=True, slots=True)
class ViewParameters:
    """What is drawn around the head."""

    horizontal_view: float = parameter(
        1.0, "Angle of the view cone from side to side.", unit="rad", minimum=0.05, maximum=3.0
    )
    aspect_ratio: float = parameter(
        4 / 3, "Width of the camera's picture over its height.", minimum=0.1, maximum=10.0
    )
    sight_length: float = parameter(
        3.0, "Length of the line of sight.", unit="m", minimum=0.1, maximum=100.0
    )
    field_radius: float = parameter(
        1.0, "Distance at which the reachable field is drawn.", unit="m", minimum=0.1, maximum=50.0
    )
    trail_seconds: float = parameter(
        5.0, "How long the target's trail stays.", unit="s", minimum=0.1, maximum=60.0
    )
    prediction_seconds: float = parameter(
        0.5, "How far ahead the target's path is drawn.", unit="s", minimum=0.05, maximum=5.0
    )

    @property
    def vertical_view(self) -> float:
        """Angle of the view cone from top to bottom [rad]."""
        return 2.0 * math.atan(math.tan(self.horizontal_view / 2.0) / self.aspect_ratio)


class GazeScene:
    """What the head looks at and could look at. Parts are drawn when they are wanted.

    Args:
        scene: gets the nodes.
        robot: the robot; parts that move with the camera are put below its link.
        parameters: sizes.
    """

    def __init__(
        self, scene: viser.SceneApi, robot: RobotScene, parameters: ViewParameters
    ) -> None:
        self._scene = scene
        self._robot = robot
        self._p = parameters
        self._path = self._new_path((0.0, 0.0, 0.0))
        self._wanted = {"target": True, "trail": True, "prediction": True}
        self._target = scene.add_icosphere(
            "/target", 0.035, _TARGET_COLOUR, subdivisions=2, visible=False
        )
        self._trail = _line(scene, "/trail", _TRAIL_COLOUR)
        self._prediction = _line(scene, "/prediction", _PREDICTION_COLOUR)
        self._of_head: dict[str, Any] = {}
        self._picture: Any = None
        self._drawn: dict[str, bool] = {}

    def set_head(self, head: PanTiltHead) -> None:
        """Draws what belongs to this head."""
        for node in self._of_head.values():
            node.remove()
        model = self._robot.model
        anywhere = dict.fromkeys(model.independent_joints, 0.0)
        self._path = self._new_path(
            model.transform(model.root, head.base_frame, anywhere).translation
        )
        camera, axis = self._robot.path(head.pointing_frame), head.pointing_axis
        p = self._p
        self._of_head = {
            "line of sight": self._scene.add_line_segments(
                f"{camera}/sight",
                np.array([[(0.0, 0.0, 0.0), [p.sight_length * a for a in axis]]]),
                _SIGHT_COLOUR,
                thickness=1.0,
                thickness_units="screen",
            ),
            "view cone": self._scene.add_frame(
                f"{camera}/view", show_axes=False, wxyz=wxyz(with_axis_forward(axis))
            ),
            "reachable field": _line(
                self._scene, f"{self._robot.path(head.base_frame)}/field", _FIELD_COLOUR
            ),
        }
        self._picture = self._add_cone(f"{camera}/view")
        field = reachable_field(self._robot.model, head, p.field_radius)
        self._of_head["reachable field"].points = field.astype(np.float32)
        for part, node in self._of_head.items():
            node.visible = self.wanted(part)

    def _add_cone(self, name: str) -> Any:
        """The edges of what the camera sees, and the place of its picture."""
        p = self._p
        right = _CONE * math.tan(p.horizontal_view / 2.0)
        down = right / p.aspect_ratio
        corners = [
            (x, y, _CONE)
            for x, y in ((-right, -down), (right, -down), (right, down), (-right, down))
        ]
        edges = [((0.0, 0.0, 0.0), corner) for corner in corners]
        edges += zip(corners, (*corners[1:], corners[0]), strict=True)
        self._scene.add_line_segments(
            f"{name}/edges",
            np.array(edges, np.float32),
            _SIGHT_COLOUR,
            thickness=1.0,
            thickness_units="screen",
        )
        return self._scene.add_image(
            f"{name}/picture",
            np.zeros((2, 2, 3), np.uint8),
            2.0 * right,
            2.0 * down,
            format="jpeg",
            cast_shadow=False,
            receive_shadow=False,
            position=(0.0, 0.0, _CONE),
            visible=False,
        )

    @property
    def parts(self) -> tuple[str, ...]:
        """What can be switched on and off."""
        return ("target", "trail", "prediction", *self._of_head)

    def wanted(self, part: str) -> bool:
        """Whether a part is switched on."""
        return self._wanted.get(part, part != "reachable field")

    def want(self, part: str, on: bool) -> None:
        """Switches a part on or off."""
        self._wanted[part] = on
        node = self._of_head.get(part)
        if node is not None:
            node.visible = on

    def legend(self) -> tuple[tuple[str, str], ...]:
        """What the colours mean that are drawn now: the meaning, and the colour as in CSS."""
        return tuple(
            (meaning, "#{:02x}{:02x}{:02x}".format(*colour))
            for part, (colour, meaning) in _LEGEND.items()
            if part in self.parts and self.wanted(part) and self._drawn.get(part, True)
        )

    def show_picture(self, picture: npt.NDArray[np.uint8] | None) -> None:
        """Shows what the camera sees in its view cone, shape (height, width, 3); None: nothing."""
        if self._picture is not None:
            if picture is not None:
                self._picture.image = picture
            self._picture.visible = picture is not None

    def remove(self) -> None:
        """Takes everything out of the scene."""
        for node in (self._target, self._trail, self._prediction, *self._of_head.values()):
            node.remove()

    def show(self, now: int, target: Vector3 | None, stamp: int | None) -> None:
        """Draws the target as it is known at the time `now` [ns], in the model's root [m].

        Args:
            now: the time.
            target: where it was; None: there is none.
            stamp: when it was there [ns]; None: now.
        """
        self._path.add(now, target, stamp)
        self._target.visible = target is not None and self._wanted["target"]
        if target is not None:
            self._target.position = target
        _draw(self._trail, self._path.trail() if self._wanted["trail"] else [])
        _draw(self._prediction, self._path.predicted() if self._wanted["prediction"] else [])
        self._drawn = {
            "target": self._target.visible,
            "trail": self._trail.visible,
            "prediction": self._prediction.visible,
        }

    def _new_path(self, head: Vector3) -> TargetPath:
        return TargetPath(self._p.trail_seconds, self._p.prediction_seconds, head)


def _line(scene: viser.SceneApi, name: str, colour: tuple[int, int, int]) -> Any:
    return scene.add_line_segments(
        name,
        np.zeros((1, 2, 3), np.float32),
        colour,
        thickness=2.0,
        thickness_units="screen",
        visible=False,
    )


def _draw(line: Any, points: Sequence[Vector3]) -> None:
    """Draws a line through points, or none at all."""
    line.visible = len(points) > 1
    if len(points) > 1:
        ends = np.asarray(points, np.float32)
        line.points = np.stack([ends[:-1], ends[1:]], axis=1)


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
