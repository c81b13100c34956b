"""Where a browser's eye is at first: the robot, what its camera sees and its target are in view."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import viser

from head_tracking.transforms import Vector3

Array = npt.NDArray[np.float64]

_AZIMUTH, _ELEVATION = math.radians(-140.0), math.radians(19.0)
"""From behind its right shoulder: what it looks at lies ahead, and pictures before its camera are
not mirrored."""

_FIELD = math.radians(38.0)
_FILLED = 0.84  # of the picture
_USUAL = 1.2  # width over height of what the panel leaves of a window
_REMEMBERED = 5
_CLOSEST = 0.3  # m
_SAME = 0.02  # m, or of the aspect ratio


class Eye(NamedTuple):
    """Where one looks from, and where to [m]."""

    position: Vector3
    look_at: Vector3


def eye(points: Array, aspect: float, field: float = _FIELD, filled: float = _FILLED) -> Eye:
    """The place from which all points are in view, as close to them as it can be.

    Args:
        points: shape (N, 3) [m].
        aspect: the picture's width over its height.
        field: its angle from top to bottom [rad].
        filled: the share of it that the points may take.
    """
    out = np.array(
        [
            math.cos(_ELEVATION) * math.cos(_AZIMUTH),
            math.cos(_ELEVATION) * math.sin(_AZIMUTH),
            math.sin(_ELEVATION),
        ]
    )
    right = np.cross((0.0, 0.0, 1.0), out)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(out, right), out])
    seen = points @ axes.T
    slopes = math.tan(field / 2.0) * filled * np.array([aspect, 1.0])
    # each side of the picture is a plane through the eye, as close as the points let it come
    high = (seen[:, :2] + seen[:, 2:] * slopes).max(axis=0)
    low = (seen[:, :2] - seen[:, 2:] * slopes).min(axis=0)
    away = max(*((high - low) / (2.0 * slopes)).tolist(), float(seen[:, 2].max()) + _CLOSEST)
    middle = (high + low) / 2.0
    there = np.array([*middle, away]) @ axes
    depth = away - float(seen[:, 2].mean())
    position, look_at = there.tolist(), (there - depth * out).tolist()
    return Eye(tuple(position), tuple(look_at))


class Framing:
    """Puts the eye of each browser that comes where it sees everything, until a person moves it.

    Args:
        server: has the browsers.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._placed: dict[int, tuple[float, list[Vector3]]] = {}
        self._moved: set[int] = set()
        server.on_client_disconnect(lambda client: self._forget(client.client_id))

    def show_first(self, points: Array) -> None:
        """Where browsers look from before they are known, and what their own reset goes back to."""
        found, first = eye(points, _USUAL), self._server.initial_camera
        first.fov, first.position, first.look_at = _FIELD, found.position, found.look_at

    def show(self, points: Array) -> None:
        """Looks after browsers that have come, or whose windows have another form.

        Args:
            points: what must be in view, shape (N, 3) [m].
        """
        for number, client in self._server.get_clients().items():
            if number in self._moved:
                continue
            camera, aspect = client.camera, float(client.camera.aspect)
            before, places = self._placed.get(number, (0.0, []))
            # a browser may still tell where it was before
            if places and min(math.dist(camera.position, one) for one in places) > _SAME:
                self._moved.add(number)
            elif abs(aspect - before) > _SAME:
                found = eye(points, aspect)
                with client.atomic():
                    camera.fov = _FIELD
                    camera.position, camera.look_at = found.position, found.look_at
                self._placed[number] = aspect, [*places, found.position][-_REMEMBERED:]

    def _forget(self, number: int) -> None:
        self._placed.pop(number, None)
        self._moved.discard(number)
