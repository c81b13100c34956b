"""Estimates where the camera sits from views of markers that stand still.

A bundle adjustment: the head's errors, the poses of the markers and what the joints' readings are
off by in each view are estimated together, by least squares with priors (Hartley and Zisserman,
Multiple View Geometry, 2nd edition, section 18.1 and appendix 6).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from head_tracking.calibration.geometry import (
    FOCAL_LENGTH,
    PAN_PLAY,
    PARAMETERS,
    TILT_PLAY,
    ZEROS,
    Array,
    Estimate,
    HeadGeometry,
    Solution,
    rotation_matrices,
)
from head_tracking.compatibility import StrEnum
from head_tracking.exceptions import HeadTrackingError
from head_tracking.vision.camera import Camera
from head_tracking.vision.opencv import cv2

FEWEST_VIEWS: Final = 8

_PRIORS: Final = np.array([parameter.prior for parameter in PARAMETERS])
_KNOWN: Final = 0.5  # of its prior deviation: a parameter with more is not told by the scene
_ROBUST: Final = 3.0  # deviations; residuals beyond count less
_FAR: Final = 3.5  # deviations: no camera is mounted that wrong, and no play that negative
_OUTLYING: Final = 5.0  # deviations: such a view is left out,
_MOST_LEFT_OUT: Final = 0.2  # of all at most
_MOST_NOISE: Final = 4.0  # px
_UNSTEADY: Final = 2.5  # readings off by so many times what was said
_MOVED: Final = 25.0  # of the cost: twice this, as chi-square of 6 degrees, once in 2e8
_SPLITS: Final = (0.25, 0.4, 0.5, 0.6, 0.75)
_POSE: Final = 6


class Reason(StrEnum):
    """Why a calibration has failed."""

    NO_PICTURE = "no picture"
    FEW_VIEWS = "few views"
    MOVED = "moved"
    INCONSISTENT = "inconsistent"
    BLURRED = "blurred"
    FAR_FROM_MODEL = "far from model"


class CalibrationError(HeadTrackingError):
    """The views do not tell where the camera sits; nothing is changed.

    Attributes:
        reason: why.
    """

    def __init__(self, reason: Reason, text: str) -> None:
        super().__init__(text)
        self.reason = reason


class View(NamedTuple):
    """A marker, seen while the head stood still.

    Attributes:
        pan: measured position of the pan joint [rad].
        tilt: of the tilt joint [rad].
        marker: its number.
        corners: in the picture, clockwise from the marker's upper left, shape (4, 2) [px].
        directions: in which pan and tilt turned last: 1, -1, or 0 if that is not known.
    """

    pan: float
    tilt: float
    marker: int
    corners: Array
    directions: tuple[int, int] = (0, 0)


def solve(
    geometry: HeadGeometry,
    camera: Camera,
    views: Sequence[View],
    marker_size: float,
    *,
    reading_deviation: float = 0.0015,
    focal_length: bool = False,
) -> Solution:
    """Estimate the errors of a head.

    Args:
        geometry: of the head, as its model has it.
        camera: its lens.
        views: in the order in which they were taken.
        marker_size: edge of the markers' black square [m].
        reading_deviation: of the joints' readings, one standard deviation [rad].
        focal_length: whether to estimate that, too.

    Raises:
        CalibrationError: the views are too few, or contradict each other or the model.
    """
    if len(views) < FEWEST_VIEWS:
        raise CalibrationError(
            Reason.FEW_VIEWS,
            f"the marker was seen in {len(views)} views; {FEWEST_VIEWS} are needed: give the "
            "marker more light, or put it nearer",
        )
    free = [k for k in range(len(PARAMETERS)) if focal_length or k != FOCAL_LENGTH]
    observations, square = _Observations.of(views, camera), _square(marker_size)
    fit = min(
        (
            _Fit(
                geometry, camera.focal_length(), observations, square, reading_deviation, poses
            ).run(free, 1.0)
            for poses in _first_poses(geometry, observations, square)
        ),
        key=lambda each: each.cost,
    )
    noise = fit.noise()
    fit.run(free, noise)
    moved = fit.movement(free, noise)
    if moved is not None:
        raise CalibrationError(
            Reason.MOVED,
            f"from about view {moved} of {len(views)} on the marker or the camera stood elsewhere: "
            "fasten both, and calibrate again",
        )
    kept = fit.consistent_views()
    if len(kept) < max(FEWEST_VIEWS, (1.0 - _MOST_LEFT_OUT) * len(views)):
        raise CalibrationError(
            Reason.INCONSISTENT,
            f"{len(views) - len(kept)} of {len(views)} views contradict the others: the marker "
            "must stand still, and the pictures must be sharp",
        )
    fit = fit.with_views(kept).run(free, fit.noise())
    noise = fit.noise()
    if noise > _MOST_NOISE:
        raise CalibrationError(
            Reason.BLURRED,
            f"corners are off by {noise:.1f} px; at most {_MOST_NOISE:.0f} are allowed: the "
            "pictures are blurred, or the marker is not flat",
        )
    unsteady = fit.unsteadiness()
    if unsteady > _UNSTEADY:
        raise CalibrationError(
            Reason.INCONSISTENT,
            f"the camera was {math.degrees(unsteady * reading_deviation):.2f} degrees aside of "
            "where the joints say: it is loose, or the joints have play",
        )
    held: list[int] = []
    while True:
        fit.run(free, noise, robust=False)
        deviations = fit.deviations(free, held)
        _check_size(fit.changes, deviations, free, marker_size)
        unknown = [k for k in free if deviations[k] > _KNOWN * _PRIORS[k]]
        if not unknown:
            break
        free.remove(unknown[-1])
        held += [unknown[-1]] * (unknown[-1] not in ZEROS)
    changes = fit.changes
    estimates = {
        parameter.name: Estimate(float(changes[k]), float(deviations[k]), k in free)
        for k, parameter in enumerate(PARAMETERS)
        if focal_length or k != FOCAL_LENGTH
    }
    return Solution(changes, estimates, noise, len(kept), len(views) - len(kept))


def _check_size(changes: Array, deviations: Array, free: Sequence[int], size: float) -> None:
    """Raise CalibrationError if no head of this model is like that."""
    for k in free:
        change, unit = PARAMETERS[k].displayed(changes[k])
        is_negative_play = k in (TILT_PLAY, PAN_PLAY) and changes[k] < -_FAR * deviations[k]
        if is_negative_play or abs(changes[k]) > _FAR * _PRIORS[k]:
            raise CalibrationError(
                Reason.FAR_FROM_MODEL,
                f"{PARAMETERS[k].name} would be {change:.1f} {unit} from the model: is the "
                f"marker really {size:g} m wide, and the model that of this robot?",
            )


class _Observations(NamedTuple):
    """Markers that were seen, one in each view.

    Attributes:
        positions: measured, of pan and tilt, shape (N, 2) [rad].
        directions: in which pan and tilt turned last, shape (N, 2); see `View`.
        markers: index of each view's marker, shape (N,).
        rays: to the corners, x and y at z = 1, shape (N, 4, 2).
    """

    positions: Array
    directions: Array
    markers: npt.NDArray[np.intp]
    rays: Array

    @staticmethod
    def of(views: Sequence[View], camera: Camera) -> _Observations:
        """Return the observations of some views."""
        _, markers = np.unique([view.marker for view in views], return_inverse=True)
        corners = np.array([view.corners for view in views], dtype=np.float64)
        rays = [camera.ray((u, v)) for u, v in corners.reshape(-1, 2).tolist()]
        return _Observations(
            np.array([(view.pan, view.tilt) for view in views]),
            np.array([view.directions for view in views], dtype=np.float64),
            markers,
            np.array(rays).reshape(corners.shape),
        )


class _Fit:
    """A least-squares problem and its solution until now.

    Args:
        geometry: of the head, as its model has it.
        focal: focal length of the camera [px].
        seen: the observations of N views.
        square: corners of a marker in its frame, shape (4, 3) [m].
        reading: deviation of a reading [rad].
        poses: of the markers, `T_base_marker`: rotation vectors and positions, shape (M, 6).

    Attributes:
        cost: half the sum of the squared residuals, in deviations.
        changes: of `PARAMETERS`, shape (12,).
    """

    def __init__(
        self,
        geometry: HeadGeometry,
        focal: float,
        seen: _Observations,
        square: Array,
        reading: float,
        poses: Array,
    ) -> None:
        self._geometry, self._focal, self._square, self._reading = geometry, focal, square, reading
        self.cost = math.inf
        self.changes = np.zeros(len(PARAMETERS))
        self._noise = 1.0
        self._seen, self._poses = seen, poses
        self._readings = np.zeros((2, len(seen.positions)))

    def with_views(self, kept: Sequence[int]) -> _Fit:
        """Return a problem with some of the views, from the solution until now."""
        fit = copy(self)
        positions, directions, markers, rays = self._seen
        fit._seen = _Observations(positions[kept], directions[kept], markers[kept], rays[kept])
        fit._readings = self._readings[:, kept]
        fit._regroup(fit._seen.markers, self._poses)
        return fit

    def moved_at(self, first: int) -> _Fit:
        """Return the problem in which all markers may stand elsewhere from a view on."""
        fit = copy(self)
        later = np.arange(len(self._seen.positions)) >= first
        fit._regroup(
            self._seen.markers + later * len(self._poses), np.concatenate([self._poses] * 2)
        )
        return fit

    def _regroup(self, markers: npt.NDArray[np.intp], poses: Array) -> None:
        """Set the marker of each view, as an index of poses; poses without a view are left out."""
        used, markers = np.unique(markers, return_inverse=True)
        self._seen, self._poses = self._seen._replace(markers=markers), poses[used]

    def run(self, free: Sequence[int], noise: float, *, robust: bool = True) -> _Fit:
        """Solve the problem with some of the parameters; the others are 0.

        Args:
            free: indices of `PARAMETERS`.
            noise: of a corner, one standard deviation [px].
            robust: outliers count less.
        """
        from scipy.optimize import least_squares

        self._noise = noise
        found = least_squares(
            lambda x: self._residuals(x, free),
            self._unknowns(free),
            jac=lambda x: self._differences(x, free),
            loss="soft_l1" if robust else "linear",
            f_scale=_ROBUST,
            x_scale="jac",
            ftol=1e-6,
            xtol=1e-6,
            max_nfev=60,
        )
        self._take(found.x, free)
        self.cost = float(found.cost)
        return self

    def _unknowns(self, free: Sequence[int]) -> Array:
        """Return what is estimated: parameters and readings in deviations, then poses."""
        return np.concatenate(
            [
                self.changes[free] / _PRIORS[free],
                self._readings.ravel() / self._reading,
                self._poses.ravel(),
            ]
        )

    def _take(self, x: Array, free: Sequence[int]) -> None:
        n = len(free)
        self.changes = np.zeros(len(PARAMETERS))
        self.changes[free] = x[:n] * _PRIORS[free]
        readings, poses = np.split(x[n:], [self._readings.size])
        self._readings = readings.reshape(2, -1) * self._reading
        self._poses = poses.reshape(-1, _POSE)

    def _residuals(self, x: Array, free: Sequence[int]) -> Array:
        """Return all residuals in deviations: corners, then priors of parameters and readings."""
        self._take(x, free)
        priors = x[: len(free) + self._readings.size]
        return np.concatenate([self._misses().ravel() / self._noise, priors])

    def _misses(self) -> Array:
        """Return how far each corner is from where it should be, shape (N, 4, 2) [px]."""
        behind = 0.5 * self.changes[[PAN_PLAY, TILT_PLAY]] * self._seen.directions
        pans, tilts = (self._seen.positions - behind).T + self._readings
        rotations, positions = self._geometry.cameras(self.changes, pans, tilts)
        turns = rotation_matrices(self._poses[:, :3])
        corners = self._poses[:, None, 3:] + self._square @ turns.transpose(0, 2, 1)
        seen = (corners[self._seen.markers] - positions[:, None]) @ rotations
        depth = np.maximum(seen[..., 2:], 1e-3)
        scale = math.exp(self.changes[FOCAL_LENGTH])
        return np.asarray(self._focal * (scale * seen[..., :2] / depth - self._seen.rays))

    def _differences(self, x: Array, free: Sequence[int]) -> Array:
        """Return the Jacobian, by differences; a reading concerns its own view only."""
        step, n, count = 1e-6, len(free), len(self._seen.positions)
        here = self._residuals(x, free)
        jacobian = np.zeros((len(here), len(x)))
        corners = self._seen.rays.size
        each = corners // count
        for k in (*range(n), *range(n + 2 * count, len(x))):
            aside = x.copy()
            aside[k] += step
            jacobian[:, k] = (self._residuals(aside, free) - here) / step
        for joint in range(2):
            columns = n + joint * count + np.arange(count)
            aside = x.copy()
            aside[columns] += step
            slopes = (self._residuals(aside, free) - here)[:corners].reshape(count, each) / step
            for view in range(count):
                rows = slice(view * each, (view + 1) * each)
                jacobian[rows, columns[view]] = slopes[view]
                jacobian[corners + columns[view], columns[view]] = 1.0
        self._take(x, free)
        return jacobian

    def noise(self) -> float:
        """Return the standard deviation of a corner [px], by the middle half of the residuals."""
        misses = np.abs(self._misses()).ravel()
        used = self.changes.size + self._poses.size + self._readings.size
        share = math.sqrt(misses.size / max(misses.size - used, 0.25 * misses.size))
        return max(0.05, float(np.median(misses)) / 0.6745 * share)

    def consistent_views(self) -> list[int]:
        """Return the views that do not contradict the others."""
        misses = np.sqrt((self._misses() ** 2).mean(axis=(1, 2))) / self.noise()
        aside = np.abs(self._readings).max(axis=0) / self._reading
        limit = _OUTLYING * max(1.0, self.unsteadiness())
        return np.flatnonzero((misses < _OUTLYING) & (aside < limit)).tolist()

    def movement(self, free: Sequence[int], noise: float) -> int | None:
        """Return the view from which on something stood elsewhere; None: nothing has moved.

        A marker that stands elsewhere from that view on explains the views much better then.
        """
        count = len(self._seen.positions)
        for share in _SPLITS:
            first = round(share * count)
            if self.cost - self.moved_at(first).run(free, noise).cost > _MOVED:
                return first
        return None

    def unsteadiness(self) -> float:
        """Return how much the readings are off in most views, over what was said of them."""
        middles = np.median(np.abs(self._readings), axis=1)
        return float(middles.max()) / 0.6745 / self._reading

    def deviations(self, free: Sequence[int], held: Sequence[int]) -> Array:
        """Return the standard deviation of each parameter; of those that are not free, the prior's.

        A parameter that is held at the model's value is wrong by its prior, and makes the free ones
        wrong (consider covariance: Tapley, Schutz and Born, Statistical Orbit Determination, 2004,
        chapter 6).

        Args:
            free: indices of the parameters that were estimated.
            held: of those that this scene does not tell.
        """
        n, both = len(free), [*free, *held]
        jacobian = self._differences(self._unknowns(both), both)
        estimated = np.delete(jacobian, np.s_[n : len(both)], axis=1)
        covariance = np.linalg.pinv(estimated.T @ estimated, hermitian=True)
        passed_on = covariance @ estimated.T @ jacobian[:, n : len(both)]
        deviations = _PRIORS.copy()
        variances = np.diag(covariance) + (passed_on**2).sum(axis=1)
        deviations[free] *= np.sqrt(variances[:n])
        return np.asarray(deviations)


def _first_poses(geometry: HeadGeometry, seen: _Observations, square: Array) -> list[Array]:
    """Return two guesses of the markers' poses: a square has two that look nearly alike."""
    guesses: list[list[Array]] = [[], []]
    extents = np.ptp(seen.rays, axis=1).min(axis=1)
    cameras = geometry.cameras(np.zeros(len(PARAMETERS)), *seen.positions.T)
    for marker in np.unique(seen.markers):
        view = int(np.argmax(np.where(seen.markers == marker, extents, -1.0)))
        _, turns, shifts, _ = cv2.solvePnPGeneric(
            square, seen.rays[view], np.eye(3), None, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
        rotation, position = (each[view] for each in cameras)
        for guess, k in zip(guesses, (0, -1), strict=True):
            vector, _ = cv2.Rodrigues(rotation @ cv2.Rodrigues(turns[k])[0])
            guess.append(np.concatenate([vector.ravel(), position + rotation @ shifts[k].ravel()]))
    return [np.array(guess) for guess in guesses]


def _square(size: float) -> Array:
    half = size / 2.0
    signs = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
    return np.asarray(half * signs)
