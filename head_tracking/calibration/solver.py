"""Estimate the calibration errors of a head from views of markers or points at rest.

A bundle adjustment by least squares with priors: the errors of the head, the poses of the markers
and the errors of the joint readings are estimated together (Hartley and Zisserman, Multiple View
Geometry, 2nd edition, section 18.1 and appendix 6).
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
    Residuals,
    rotation_matrices,
)
from head_tracking.calibration.result import Calibration
from head_tracking.compatibility import StrEnum
from head_tracking.exceptions import HeadTrackingError
from head_tracking.vision.camera import Camera
from head_tracking.vision.opencv import cv2

FEWEST_VIEWS: Final = 8

_PRIORS: Final = np.array([parameter.prior for parameter in PARAMETERS])
_READING: Final = 0.0015  # rad: minimum standard deviation of a reading of a joint
_EXACT: Final = 1e-6  # rad: of one that is where the joint was measured
_KNOWN: Final = 0.5  # of the prior deviation: a parameter with more is not observable
_ROBUST: Final = 3.0  # deviations: larger residuals have less weight
_FAR: Final = 3.5  # deviations: larger errors, or negative play, contradict the model
_NEGATIVE_PLAY: Final = math.radians(0.5)  # less is noise
_OUTLYING: Final = 5.0  # deviations: such a view is excluded,
_MOST_LEFT_OUT: Final = 0.2  # at most this share of all
_LEAST_FREE: Final = 0.25  # of the residuals: at least so many degrees of freedom
_LEAST_NOISE: Final = 0.5  # px: detected corners have errors that are alike in many views
_MOST_NOISE: Final = 4.0  # px
_UNSTEADY: Final = 2.5  # times the stated deviation of the readings
_MOVED: Final = 5.7  # deviations: a motion reduces the cost by a chi-square with p = 5e-9
_SPLITS: Final = (0.25, 0.4, 0.5, 0.6, 0.75)
_SIZES: Final = (1.0, 0.5, 0.67, 0.8, 1.25, 1.5, 2.0)  # tried factors of the stated marker size
_RESIZED: Final = 5.4  # decrease of the cost: chi-square with 1 degree of freedom, p = 0.001
_POSE: Final = 6
_POINT_DISTANCE: Final = 2.0  # m: expected distance of a point from the camera,
_POINT_SPREAD: Final = 1.5  # m: and its standard deviation


class Reason(StrEnum):
    """Reason of a failed calibration."""

    NOT_INSTALLED = "not installed"
    NO_PICTURE = "no picture"
    FEW_VIEWS = "few views"
    TWO_MARKERS = "two markers"
    MOVED = "moved"
    INCONSISTENT = "inconsistent"
    BLURRED = "blurred"
    FAR_FROM_MODEL = "far from model"


class CalibrationError(HeadTrackingError):
    """The calibration has failed; nothing is changed.

    Attributes:
        reason: reason of the failure.
    """

    def __init__(self, reason: Reason, text: str) -> None:
        super().__init__(f"{reason}: {text}")
        self.reason = reason


class View(NamedTuple):
    """A marker or a point in an image, with the head at rest.

    Attributes:
        pan: measured position of the pan joint [rad].
        tilt: measured position of the tilt joint [rad].
        marker: number of the marker or of the point.
        corners: corners in the image, clockwise from the marker's upper left, shape (4, 2) [px]; of
            a point, shape (1, 2).
        directions: directions of the last motion of pan and tilt: 1, -1, or 0: unknown.
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
    marker_size: float | None,
    *,
    focal_length: bool = False,
) -> Calibration:
    """Estimate the errors of a head.

    Args:
        geometry: geometry of the head in its model.
        camera: the camera.
        views: views in the order of recording, all of markers or all of points.
        marker_size: edge of the black square of the markers [m]; None: the views show points.
        focal_length: whether to estimate the focal length.

    Raises:
        CalibrationError: there are too few views, or they contradict each other or the model.
    """
    images = len({(view.pan, view.tilt) for view in views})
    if images < FEWEST_VIEWS:
        raise CalibrationError(
            Reason.FEW_VIEWS,
            f"the target is visible from {images} positions of the joints; {FEWEST_VIEWS} are "
            "needed: use more light, a smaller distance, or wider limits of the joints",
        )
    observations = _Observations.of(views, camera)
    free = [k for k in range(len(PARAMETERS)) if focal_length or k != FOCAL_LENGTH]
    if marker_size is None:
        shape, spread = np.zeros((1, 3)), _POINT_SPREAD
        guesses = [_first_points(geometry, observations)]
    else:
        shape, spread = _square(marker_size), math.inf
        guesses = _first_poses(geometry, observations, shape)
    focal = camera.focal_length()
    fits = [
        _Fit(geometry, focal, observations, shape, poses, spread).run(free, 1.0)
        for poses in guesses
    ]
    fit = min(fits, key=lambda each: each.cost)
    noise = fit.noise(free)
    fit.run(free, noise)
    kept = fit.consistent_views(free)
    matched = fit.matched_views(kept)
    steady = fit.with_views(matched).run(free, noise)
    moved = steady.movement(free, steady.noise(free))
    if moved is not None:
        raise CalibrationError(
            Reason.MOVED,
            f"the target or the camera moved at about view {matched[moved]} of {len(views)}: "
            "fasten both, check that the camera is upright and not mirrored, and calibrate again",
        )
    if len(kept) < max(FEWEST_VIEWS, (1.0 - _MOST_LEFT_OUT) * len(views)):
        raise CalibrationError(
            Reason.INCONSISTENT,
            f"{len(views) - len(kept)} of {len(views)} views are outliers: the target must not "
            "move, and the images must be sharp",
        )
    fit = fit.with_views(kept).run(free, fit.noise(free))
    noise = fit.noise(free, robust=False)
    if noise > _MOST_NOISE:
        raise CalibrationError(
            Reason.BLURRED,
            f"the deviation of the corners is {noise:.1f} px; the maximum is {_MOST_NOISE:.0f}: "
            "the images are blurred, the target moves, or the marker is not flat",
        )
    unsteady = fit.unsteadiness(robust=False)
    if unsteady > _UNSTEADY:
        raise CalibrationError(
            Reason.INCONSISTENT,
            f"camera and joints differ by {math.degrees(unsteady * _READING):.2f} "
            "degrees: the camera is loose, or the joints have play",
        )
    fit = fit.with_readings(max(1.0, unsteady) * _READING)
    if marker_size is not None and (factor := fit.better_size(free, noise)) is not None:
        raise CalibrationError(
            Reason.FAR_FROM_MODEL,
            f"the views fit a marker of about {factor * marker_size:.2g} m better than one of "
            f"{marker_size:g} m: measure the edge of its black square, and check the angle of view "
            "and the robot model",
        )
    held: list[int] = []
    while True:
        fit.run(free, noise, robust=False)
        deviations = fit.deviations(free, held)
        _check_plausible(fit.changes, deviations, free)
        unknown = [k for k in free if deviations[k] > _KNOWN * _PRIORS[k]]
        if not unknown:
            break
        free.remove(unknown[-1])
        held += [unknown[-1]] * (unknown[-1] not in ZEROS)
    changes = fit.changes
    exact = fit.with_readings(_EXACT)
    after, before = exact.misses(), exact.run([], noise, robust=False).misses()
    residuals = Residuals(focal, fit.pixels(), before, after)
    estimates = {
        parameter.name: Estimate(float(changes[k]), float(deviations[k]), k in free)
        for k, parameter in enumerate(PARAMETERS)
        if focal_length or k != FOCAL_LENGTH
    }
    left_out = len(views) - len(kept)
    return Calibration.of(geometry, changes, estimates, noise, len(kept), left_out, residuals)


def _check_plausible(changes: Array, deviations: Array, free: Sequence[int]) -> None:
    """Raise CalibrationError if an estimate is implausible for this model."""
    for k in free:
        change, unit = PARAMETERS[k].displayed(changes[k])
        is_negative_play = k in (TILT_PLAY, PAN_PLAY) and changes[k] < -max(
            _FAR * deviations[k], _NEGATIVE_PLAY
        )
        if is_negative_play or abs(changes[k]) > _FAR * _PRIORS[k]:
            raise CalibrationError(
                Reason.FAR_FROM_MODEL,
                f"{PARAMETERS[k].name} differs by {change:.1f} {unit} from the model: check the "
                "marker size, the angle of view, the robot model, and that the camera is upright",
            )


class _Observations(NamedTuple):
    """Markers (K = 4 corners) or points (K = 1) in images, one in each view.

    Attributes:
        positions: measured pan and tilt, shape (N, 2) [rad].
        directions: directions of the last motion, shape (N, 2); see `View`.
        images: index of the positions of each view, shape (N,): an image was taken at each.
        markers: index of the marker of each view, shape (N,).
        rays: rays of the corners, x and y at z = 1, shape (N, K, 2).
    """

    positions: Array
    directions: Array
    images: npt.NDArray[np.intp]
    markers: npt.NDArray[np.intp]
    rays: Array

    @staticmethod
    def of(views: Sequence[View], camera: Camera) -> _Observations:
        """Convert views."""
        _, markers = np.unique([view.marker for view in views], return_inverse=True)
        positions = np.array([(view.pan, view.tilt) for view in views])
        _, images = np.unique(positions, axis=0, return_inverse=True)
        corners = np.array([view.corners for view in views], dtype=np.float64)
        rays = [camera.ray((u, v)) for u, v in corners.reshape(-1, 2).tolist()]
        return _Observations(
            positions,
            np.array([view.directions for view in views], dtype=np.float64),
            images.ravel(),
            markers,
            np.array(rays).reshape(corners.shape),
        )


class _Fit:
    """A least-squares problem and its present solution.

    Args:
        geometry: geometry of the head in its model.
        focal: focal length of the camera [px].
        seen: observations of N views.
        shape: corners of a marker in its frame, shape (K, 3) [m].
        poses: `T_base_marker` of the markers: rotation vectors and positions, shape (M, 6).
        spread: standard deviation of `poses` [m]; infinite: only the views determine them.

    Attributes:
        cost: half the sum of the squared, normalised residuals.
        changes: values of `PARAMETERS`, shape (12,).
    """

    def __init__(
        self,
        geometry: HeadGeometry,
        focal: float,
        seen: _Observations,
        shape: Array,
        poses: Array,
        spread: float,
    ) -> None:
        self._geometry, self._focal, self._shape, self._reading = geometry, focal, shape, _READING
        self.cost = math.inf
        self.changes = np.zeros(len(PARAMETERS))
        self._noise = 1.0
        self._seen, self._poses = seen, poses
        self._expected, self._spread = poses, spread
        self._readings = np.zeros((2, 1 + int(seen.images.max())))

    def with_views(self, kept: Sequence[int]) -> _Fit:
        """Return a problem with some of the views, starting at the present solution."""
        fit = copy(self)
        used, images = np.unique(self._seen.images[kept], return_inverse=True)
        seen = _Observations._make(each[kept] for each in self._seen)
        fit._seen = seen._replace(images=images)
        fit._readings = self._readings[:, used]
        fit._regroup(fit._seen.markers)
        return fit

    def with_readings(self, deviation: float) -> _Fit:
        """Return the problem with another standard deviation of the readings [rad]."""
        fit = copy(self)
        fit._reading, fit._readings = deviation, np.zeros_like(self._readings)
        return fit

    def moved_at(self, first: int) -> _Fit:
        """Return the problem in which all markers have new poses from a view on."""
        fit = copy(self)
        later = np.arange(len(self._seen.positions)) >= first
        fit._regroup(self._seen.markers + later * len(self._poses))
        return fit

    def _regroup(self, markers: npt.NDArray[np.intp]) -> None:
        """Set the index of the pose of each view, modulo the number of poses."""
        used, markers = np.unique(markers, return_inverse=True)
        used %= len(self._poses)
        self._seen = self._seen._replace(markers=markers)
        self._poses, self._expected = self._poses[used], self._expected[used]

    def run(self, free: Sequence[int], noise: float, *, robust: bool = True) -> _Fit:
        """Solve the problem for some parameters; the others are 0.

        Args:
            free: indices of `PARAMETERS`.
            noise: standard deviation of a corner [px].
            robust: whether to reduce the weight of outliers.
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
        self._set(found.x, free)
        self.cost = float(found.cost)
        return self

    def _unknowns(self, free: Sequence[int]) -> Array:
        """Return the unknowns: normalised parameters and readings, then poses."""
        return np.concatenate(
            [
                self.changes[free] / _PRIORS[free],
                self._readings.ravel() / self._reading,
                self._poses.ravel(),
            ]
        )

    def _set(self, x: Array, free: Sequence[int]) -> None:
        n = len(free)
        self.changes = np.zeros(len(PARAMETERS))
        self.changes[free] = x[:n] * _PRIORS[free]
        readings, poses = np.split(x[n:], [self._readings.size])
        self._readings = readings.reshape(2, -1) * self._reading
        self._poses = poses.reshape(-1, _POSE)

    def _residuals(self, x: Array, free: Sequence[int]) -> Array:
        """Return the normalised residuals: corners, then priors of the unknowns."""
        self._set(x, free)
        priors = x.copy()
        priors[len(free) + self._readings.size :] -= self._expected.ravel()
        priors[len(free) + self._readings.size :] /= self._spread
        return np.concatenate([self._errors().ravel() / self._noise, priors])

    def _errors(self) -> Array:
        """Return the reprojection errors of the corners, shape (N, K, 2) [px]."""
        behind = 0.5 * self.changes[[PAN_PLAY, TILT_PLAY]] * self._seen.directions
        pans, tilts = (self._seen.positions - behind).T + self._readings[:, self._seen.images]
        rotations, positions = self._geometry.cameras(self.changes, pans, tilts)
        turns = rotation_matrices(self._poses[:, :3])
        corners = self._poses[:, None, 3:] + self._shape @ turns.transpose(0, 2, 1)
        seen = (corners[self._seen.markers] - positions[:, None]) @ rotations
        depth = np.maximum(seen[..., 2:], 1e-3)
        scale = math.exp(self.changes[FOCAL_LENGTH])
        return np.asarray(self._focal * (scale * seen[..., :2] / depth - self._seen.rays))

    def _differences(self, x: Array, free: Sequence[int]) -> Array:
        """Return the Jacobian by finite differences.

        A reading affects its own image only, and a pose its own marker: one difference serves all.
        """
        step, n, images = 1e-6, len(free), self._readings.shape[1]
        here = self._residuals(x, free)
        corners = np.arange(self._seen.rays.size)
        each = self._seen.rays[0].size
        poses = n + 2 * images
        blocks = [(np.array([k]), np.zeros_like(corners)) for k in range(n)]
        for joint in range(2):
            columns = n + joint * images + np.arange(images)
            blocks.append((columns, np.repeat(self._seen.images, each)))
        for part in range(_POSE):
            blocks.append(
                (np.arange(poses + part, len(x), _POSE), np.repeat(self._seen.markers, each))
            )
        jacobian = np.zeros((len(here), len(x)))
        for columns, owners in blocks:
            aside = x.copy()
            aside[columns] += step
            slopes = (self._residuals(aside, free) - here)[: corners.size] / step
            jacobian[corners, columns[owners]] = slopes
        unknowns = np.arange(len(x))
        jacobian[corners.size + unknowns, unknowns] = np.where(
            unknowns < poses, 1.0, 1.0 / self._spread
        )
        self._set(x, free)
        return jacobian

    def noise(self, free: Sequence[int], *, robust: bool = True) -> float:
        """Return the standard deviation of a corner [px].

        The fit absorbs a part of the noise. With markers this counts every unknown, which is
        cautious, because the pose of a small marker is ambiguous. With points it is the trace of
        the hat matrix, because priors determine most of the readings.

        Args:
            free: indices of `PARAMETERS`.
            robust: whether to use the median of the residuals; their mean square scatters less. Of
                markers it is the median always: they have more residuals.
        """
        misses = np.abs(self._errors()).ravel()
        used = float(self.changes.size + self._poses.size + self._readings.size)
        typical = float(np.median(misses)) / 0.6745
        if self._has_points:
            orthonormal, _ = np.linalg.qr(self._differences(self._unknowns(free), free))
            used = float((orthonormal[: misses.size] ** 2).sum())
            typical = typical if robust else math.sqrt(float(np.mean(misses**2)))
        share = math.sqrt(misses.size / max(misses.size - used, _LEAST_FREE * misses.size))
        return max(_LEAST_NOISE, typical * share)

    @property
    def _has_points(self) -> bool:
        return len(self._shape) == 1

    def pixels(self) -> Array:
        """Return the seen corners relative to the optical axis, shape (N * K, 2) [px]."""
        return self._focal * self._seen.rays.reshape(-1, 2)

    def misses(self) -> Array:
        """Return the differences of the expected corners from the seen ones, as `pixels`."""
        return self._errors().reshape(-1, 2)

    def consistent_views(self, free: Sequence[int]) -> list[int]:
        """Return the indices of the views that are no outliers."""
        misses = np.sqrt((self._errors() ** 2).mean(axis=(1, 2))) / self.noise(free)
        aside = np.abs(self._readings).max(axis=0)[self._seen.images] / self._reading
        limit = _OUTLYING * max(1.0, self.unsteadiness())
        return np.flatnonzero((misses < _OUTLYING) & (aside < limit)).tolist()

    def matched_views(self, kept: Sequence[int]) -> list[int]:
        """Return the indices of the consistent views, and of all in images with few of these.

        The others are points of a room that were confused: they look like a motion.
        """
        images = self._seen.images
        found = np.bincount(images[kept], minlength=1 + int(images.max()))
        is_matched = (found < 0.5 * np.bincount(images))[images]
        is_matched[kept] = True
        return np.flatnonzero(is_matched).tolist()

    def movement(self, free: Sequence[int], noise: float) -> int | None:
        """Return the view at which marker or camera moved; None: no motion.

        After a motion, new poses of the markers from that view on reduce the cost significantly.
        """
        count = len(self._seen.positions)
        for share in _SPLITS:
            first = round(share * count)
            moved = self.moved_at(first)
            added = (len(moved._poses) - len(self._poses)) * (3 if self._has_points else _POSE)
            if not added:
                continue
            gain = self.cost - moved.run(free, noise).cost
            ratio = 1.0
            if self._has_points:  # few residuals: a motion looks like noise
                ratio = noise / min(noise, moved.noise(free, robust=False))
            if gain * ratio**2 > 0.5 * _unlikely(added):
                return first
        return None

    def better_size(self, free: Sequence[int], noise: float) -> float | None:
        """Return the factor of the marker size that explains the views significantly better.

        The offset between camera and joints tells the scale. None: the stated size is consistent.
        """
        costs = {factor: self.resized(factor).run(free, noise).cost for factor in _SIZES}
        best = min(costs, key=costs.__getitem__)
        return best if costs[1.0] - costs[best] > _RESIZED else None

    def resized(self, factor: float) -> _Fit:
        """Return the problem with markers of another size, at another distance."""
        fit = copy(self)
        fit._shape = factor * self._shape
        fit._poses = self._poses * np.repeat((1.0, factor), 3)
        return fit

    def unsteadiness(self, *, robust: bool = True) -> float:
        """Return the deviation of the readings relative to the stated one.

        Args:
            robust: whether to use the median; a camera that is loose on one side only hides there.
        """
        if robust:
            return float(np.median(np.abs(self._readings), axis=1).max()) / 0.6745 / self._reading
        return float(self._readings.std(axis=1).max()) / self._reading

    def deviations(self, free: Sequence[int], held: Sequence[int]) -> Array:
        """Return the standard deviations of the parameters; of those that are not free, the priors.

        A parameter that is held at the value of the model has the error of its prior, which affects
        the free ones (consider covariance: Tapley, Schutz and Born, Statistical Orbit
        Determination, 2004, chapter 6).

        Args:
            free: indices of the estimated parameters.
            held: indices of the parameters that are not observable.
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
    """Return two initial guesses of the marker poses: the image of a square is ambiguous."""
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


def _first_points(geometry: HeadGeometry, seen: _Observations) -> Array:
    """Return initial guesses of points at one distance, as poses without a rotation."""
    rotations, positions = geometry.cameras(np.zeros(len(PARAMETERS)), *seen.positions.T)
    _, first = np.unique(seen.markers, return_index=True)
    rays = np.pad(seen.rays[first, 0], ((0, 0), (0, 1)), constant_values=1.0)
    rays *= _POINT_DISTANCE / np.linalg.norm(rays, axis=1, keepdims=True)
    points = positions[first] + np.einsum("nij,nj->ni", rotations[first], rays)
    return np.pad(points, ((0, 0), (3, 0)))


def _unlikely(freedom: int) -> float:
    """Return the chi-square that is `_MOVED` deviations too large (Wilson and Hilferty, 1931)."""
    variance = 2.0 / (9.0 * freedom)
    return freedom * (1.0 - variance + _MOVED * math.sqrt(variance)) ** 3


def _square(size: float) -> Array:
    half = size / 2.0
    signs = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
    return np.asarray(half * signs)
