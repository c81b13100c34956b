"""Whether the joints turn the camera as they say, by what a camera that they carry sees.

Points of such a camera are placed with the joints as they were measured. If a servo is mounted the
wrong way round, or pan and tilt are crosswise, a target that stands still is placed elsewhere with
every turn of the head, exactly in step with it, and the head runs after its own motion. The points
tell: placed as if the head were mounted in each possible way, they make a smooth path for the way
that is true. No bus can tell: the servos do what they are told.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import numpy.typing as npt

from head_tracking.gaze import PanTiltHead, Sight

Array = npt.NDArray[np.float64]

_WAYS: Array = np.array(
    [
        ((1, 0), (0, 1)),
        ((-1, 0), (0, 1)),
        ((1, 0), (0, -1)),
        ((-1, 0), (0, -1)),
        ((0, 1), (1, 0)),
        ((0, 1), (-1, 0)),
        ((0, -1), (1, 0)),
        ((0, -1), (-1, 0)),
    ],
    dtype=np.float64,
)
"""How far pan and tilt of the camera turn by the pan servo, and by the tilt servo; the first: as
they should; of ways that explain alike the earlier one is named."""

_ERRORS: Array = np.arange(-0.15, 0.151, 0.025)
"""Stamp errors [s]: each way of mounting is compared at the one that suits it best."""

_WINDOW = 1.0  # s; over which a path is compared with a line and a parabola
_FEWEST, _LEAST, _MOST = 9, 6, 20  # points in it: if it takes longer; to begin with; of more some
_HISTORY = 2.0  # s of readings and points
_EVERY = 0.03  # s; no judgement more often
_TURNED = 0.1  # rad; less motion of the placed target tells nothing
_ROUGH = 0.01  # rad; a path as smooth as this is well explained
_NOISE = 0.002  # rad; smoother than this no path needs to be
_WRONG = (30.0, 8.0)  # times smoother than as measured, by line and parabola: mounted that way
_RIGHT = (20.0, 5.0)  # times rougher: not mounted that way
_SURE = 20  # judgements: after more of them proportionally more must be smoother; see `evidence`
_ALIKE = 2.0  # times; ways that differ by less explain alike
_PAUSE = 1.0  # s without readings, in which somebody may have mounted the head anew


class Mounting:
    """Finds out by the first motions how the head is mounted.

    Times are in seconds on the clock of the stamps.

    Args:
        head: that is turned, and carries the camera.

    Attributes:
        evidence: the strongest until now that it is mounted wrong; from 1 on that is said. The
            first motions show it, so that later ones have to show it more clearly.
    """

    def __init__(self, head: PanTiltHead) -> None:
        self.evidence = 0.0
        self._head = head
        self._times: deque[float] = deque()
        self._readings: deque[tuple[float, float]] = deque()
        self._points: deque[tuple[float, Sight]] = deque()
        self._judged, self._judgements = -math.inf, 0
        self._allow(np.arange(len(_WAYS)))

    def reset(self) -> None:
        """Nothing is known any more."""
        self.__init__(self._head)  # type: ignore[misc]

    def joints_read(self, stamp: float, positions: tuple[float, float]) -> None:
        """Takes pan and tilt [rad] as measured at `stamp` [s]; stamps rise."""
        if self._times and stamp - self._times[-1] > _PAUSE:
            self.reset()
        self._times.append(stamp)
        self._readings.append(positions)
        while self._times[0] < stamp - _HISTORY:
            self._times.popleft()
            self._readings.popleft()

    def point_seen(self, stamp: float, sight: Sight) -> str:
        """Takes a point of a camera on the head; what is wrong, empty: nothing is known to be.

        Args:
            stamp: of the point [s].
            sight: as it was placed.
        """
        if not self._turns or (self._points and stamp <= self._points[-1][0]):
            return ""
        self._points.append((stamp, sight))
        while self._points[0][0] < stamp - _HISTORY:
            self._points.popleft()
        if len(self._points) < _LEAST or not self._tells():
            return ""
        oldest, newest = self._times[0], self._times[-1]
        known = [point for point in self._points if oldest < point[0] <= newest]
        if len(known) < _LEAST or known[-1][0] - self._judged < _EVERY:
            return ""
        start = min(known[-1][0] - _WINDOW, known[-_FEWEST:][0][0])
        window = [point for point in known if point[0] >= start]
        self._judged = known[-1][0]
        return self._judge(window[:: -math.ceil(len(window) / _MOST)][::-1])

    def _tells(self) -> bool:
        """Whether the head has turned so that it makes a difference how it is mounted."""
        if not self._readings:
            return False
        pan, tilt = (max(angles) - min(angles) for angles in zip(*self._readings, strict=True))
        return any(a * pan + b * tilt > _TURNED for a, b in self._turns)

    def _judge(self, window: list[tuple[float, Sight]]) -> str:
        """What is wrong by these points, if anything is."""
        stamps = np.array([stamp for stamp, _ in window])
        times, readings = np.array(self._times), np.array(self._readings).T
        head = np.array([np.interp(stamps, times, angles) for angles in readings])
        self._judgements += 1
        possible = self._possible
        sights = np.array([(sight.pan, sight.tilt) for _, sight in window]).T
        at = (stamps[:, None] - _ERRORS).ravel()
        turned = np.array([np.interp(at, times, angles) for angles in readings])
        camera = np.einsum("wsa,sk->awk", _WAYS[possible], turned)
        shape = (2, len(possible), len(stamps), len(_ERRORS))
        paths = self._placed(sights, head, camera.reshape(shape))
        floor = len(stamps) * _NOISE**2
        rough = _roughness(stamps, paths).min(axis=2) + floor
        smoother = rough[:, :1] / rough[:, 1:]
        if rough[0, 0] > floor + len(stamps) * _ROUGH**2:
            evidence = (smoother / np.array(_WRONG)[:, None]).min(axis=0)
            strongest = float(evidence.max()) / max(1.0, self._judgements / _SURE)
            self.evidence = max(self.evidence, strongest)
            if strongest > 1.0:
                alike = evidence > evidence.max() / _ALIKE
                return self._named(int(possible[1 + int(alike.argmax())]))
        still = (smoother * np.array(_RIGHT)[:, None] > 1.0).any(axis=0)
        if not still.all():
            self._allow(np.concatenate([[0], possible[1:][still]]))
        return ""

    def _allow(self, possible: npt.NDArray[np.int_]) -> None:
        """Only these ways are possible from now on, by their places in `_WAYS`."""
        self._possible = possible
        elsewhere = np.abs(_WAYS[possible[1:]] - _WAYS[0]).max(axis=2)
        self._turns: list[tuple[float, float]] = [tuple(row) for row in elsewhere.tolist()]

    def _placed(self, sights: Array, head: Array, camera: Array) -> Array:
        """Pan and tilt to points, had the camera stood otherwise than the joints say.

        Args:
            sights: pan and tilt as placed by the joints, shape (2, n) [rad].
            head: pan and tilt of the joints, shape (2, n) [rad].
            camera: those of the camera, shape (2, ways, n, errors) [rad].
        """
        level = self._head.slope
        down, aside = sights[1] + level, sights[0] - head[0]
        x, y, z = np.cos(down) * np.cos(aside), np.cos(down) * np.sin(aside), np.sin(down)
        x, z = _turned(x, z, -(head[1] + level))
        tilt = camera[1] + level
        x, z = _turned(x[:, None], z[:, None], tilt)
        y = y[:, None]
        pan = camera[0] + np.unwrap(np.arctan2(y, x), axis=-2)
        return np.stack([pan, np.arctan2(z, np.hypot(x, y)) - level])

    def _named(self, way: int) -> str:
        (by_pan, _), (_, by_tilt) = _WAYS[way]
        pan, tilt = self._head.pan_joint, self._head.tilt_joint
        if not by_pan:
            return (
                f"{pan} and {tilt} are crosswise, as the camera sees it: swap the servos' ids, or "
                "`servo calibrate` with the ids the other way round (or is the camera rolled?)"
            )
        wrong = [joint for joint, way in ((pan, by_pan), (tilt, by_tilt)) if way < 0]
        return (
            f"{' and '.join(wrong)} {'turns' if len(wrong) == 1 else 'turn'} against what the "
            "servo says, as the camera sees it: find the direction by `servo calibrate` (or is "
            f"the picture {'mirrored' if len(wrong) == 1 else 'upside down'}?)"
        )


def _turned(x: Array, z: Array, angle: Array) -> tuple[Array, Array]:
    """Forwards and down, turned down by an angle [rad]."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return x * cosine - z * sine, x * sine + z * cosine


def _roughness(stamps: Array, paths: Array) -> Array:
    """What a line and a parabola leave of paths, squared and summed up [rad^2].

    Of points that are not too few the one that fits worst is left out: it may be an outlier.

    Args:
        stamps: of the points, shape (n,) [s].
        paths: of pan and tilt, shape (2, ways, n, errors) [rad].

    Returns:
        Shape (2, ways, errors).
    """
    centred = (stamps - stamps.mean()) / (stamps[-1] - stamps[0])
    basis = np.linalg.qr(np.vander(centred, 3, increasing=True))[0]
    paths = paths - paths[:, :, :1]
    found = []
    for degree in (1, 2):
        columns = basis[:, : degree + 1]
        left = paths - columns @ (columns.T @ paths)
        squares = (left * left).sum(axis=0)
        rough = squares.sum(axis=1)
        if len(stamps) >= _FEWEST:
            rough -= (squares / (1.0 - (columns * columns).sum(axis=1))[:, None]).max(axis=1)
        found.append(np.maximum(rough, 0.0))
    return np.array(found)
