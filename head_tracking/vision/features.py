"""Detector of a selected cluster of features, by optical flow and template matching."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from head_tracking.parameters import parameter
from head_tracking.vision.camera import Box
from head_tracking.vision.candidate import Candidate, Detector, Frame
from head_tracking.vision.opencv import cv2

Gray: TypeAlias = npt.NDArray[np.uint8]
Points: TypeAlias = npt.NDArray[np.float32]

_TEMPLATE = 32  # pixels: longer edge of the template
_MARGIN = 1.5
_FLOW = {
    "winSize": (15, 15),
    "maxLevel": 3,
    "criteria": (3, 12, 0.03),
}
_SMALLEST_BOX = 8  # pixels


@dataclass(frozen=True, slots=True)
class FeatureParameters:
    """Tracking of the cluster."""

    max_features: int = parameter(60, "Maximum number of features.", minimum=8, maximum=1000)
    min_features: int = parameter(
        15, "With fewer features, new ones are detected in the cluster.", minimum=3, maximum=1000
    )
    match: float = parameter(
        0.6,
        "Minimum correlation with the template: below it the cluster is lost.",
        minimum=0.1,
        maximum=1.0,
    )


class FeatureDetector(Detector):
    """Follows the object in a box that a user has drawn.

    Lucas-Kanade flow is computed forward and backward; features that do not return to their start,
    or leave the cluster, are dropped. A template of the selected box corrects drift and finds the
    cluster again after a loss.
    """

    Parameters = FeatureParameters

    def __init__(self, parameters: FeatureParameters) -> None:
        super().__init__(parameters)
        self._template: Gray | None = None
        self._before: Gray | None = None
        self._points: Points = np.zeros((0, 2), np.float32)
        self._box = Box(0, 0, 0, 0)

    @property
    def has_selection(self) -> bool:
        """Whether an object was selected."""
        return self._template is not None

    def select(self, frame: Frame, box: Box) -> None:
        """Learn the object in a box, if it is large and has contrast."""
        self.reset()
        if frame.picture is None:
            return
        box = box.clipped(*frame.picture.size)
        if min(box.width, box.height) < _SMALLEST_BOX:
            return
        gray = frame.picture.gray
        scale = _TEMPLATE / max(box.width, box.height)
        size = (max(4, round(box.width * scale)), max(4, round(box.height * scale)))
        template = cv2.resize(gray[box.slices()], size, interpolation=cv2.INTER_AREA)
        if float(template.std()) < 4.0:
            return  # no contrast
        self._template = template
        self._begin(gray, box)

    def reset(self) -> None:
        """Discard the selected object."""
        self._template = self._before = None
        self._points = np.zeros((0, 2), np.float32)

    def detect(self, frame: Frame, hints: Sequence[Box]) -> list[Candidate]:
        """Return the selected cluster if it is visible."""
        if self._template is None or frame.picture is None:
            return []
        gray = frame.picture.gray
        followed = self._flow(gray)
        match = self._compare(gray, self._template) if followed else 0.0
        if match < self.parameters.match:
            match = self._search(gray, self._template)
        self._before = gray
        if match < self.parameters.match:
            self._points = np.zeros((0, 2), np.float32)
            return []
        if len(self._points) < self.parameters.min_features:
            self._begin(gray, self._box)
        return [Candidate(self._box, self._box.centre, match, points=self._points)]

    def _begin(self, gray: Gray, box: Box) -> None:
        """Detect features in a box."""
        inside = box.clipped(gray.shape[1], gray.shape[0])
        rows, columns = inside.slices()
        part = gray[rows, columns]
        self._box, self._before = box, gray
        self._points = np.zeros((0, 2), np.float32)
        if min(part.shape) < _SMALLEST_BOX:
            return
        found = cv2.goodFeaturesToTrack(part, self.parameters.max_features, 0.02, 4)
        if found is not None:
            self._points = found.reshape(-1, 2) + np.array([columns.start, rows.start], np.float32)

    def _flow(self, gray: Gray) -> bool:
        """Move features and box by the optical flow; return whether enough features remain."""
        before, points = self._before, self._points
        if before is None or before.shape != gray.shape or len(points) < 3:
            return False
        after, there, _ = cv2.calcOpticalFlowPyrLK(before, gray, points, None, **_FLOW)
        back, here, _ = cv2.calcOpticalFlowPyrLK(gray, before, after, None, **_FLOW)
        steady = (there.ravel() > 0) & (here.ravel() > 0)
        steady &= np.abs(back - points).max(axis=1) < 1.0
        if steady.sum() < 3:
            return False
        motion, inliers = cv2.estimateAffinePartial2D(
            points[steady], after[steady], ransacReprojThreshold=2.0
        )
        if motion is None:
            return False
        scale = float(np.hypot(motion[0, 0], motion[1, 0]))
        if not 0.5 < scale < 2.0:
            return False
        kept = after[steady][inliers.ravel() > 0]
        u, v = (motion @ [*self._box.centre, 1.0]).tolist()
        width, height = self._box.width * scale, self._box.height * scale
        self._box = Box(u - width / 2, v - height / 2, width, height)
        around = self._box.grown(1.1)
        inside = (
            (kept[:, 0] >= around.x)
            & (kept[:, 0] <= around.x + around.width)
            & (kept[:, 1] >= around.y)
            & (kept[:, 1] <= around.y + around.height)
        )
        self._points = kept[inside]
        return len(self._points) >= 3

    def _compare(self, gray: Gray, template: Gray) -> float:
        """Return the correlation of the box with the template; move the box to the best match."""
        around = self._box.grown(_MARGIN)
        whole = around.clipped(gray.shape[1], gray.shape[0])
        if whole.width < 0.75 * around.width or whole.height < 0.75 * around.height:
            return 0.0
        rows, columns = whole.slices()
        match, x, y = _best_match(gray[rows, columns], template, self._box.width)
        if match >= self.parameters.match:
            # a template pixel covers several image pixels: correct a part of the difference
            self._box = self._box._replace(
                x=self._box.x + 0.2 * (columns.start + x - self._box.x),
                y=self._box.y + 0.2 * (rows.start + y - self._box.y),
            )
        return match

    def _search(self, gray: Gray, template: Gray) -> float:
        """Search the whole image for the template; return the best correlation."""
        best, where = 0.0, self._box
        for factor in (0.8, 1.0, 1.25):
            width = self._box.width * factor
            match, x, y = _best_match(gray, template, width)
            if match > best:
                best, where = match, Box(x, y, width, self._box.height * factor)
        if best >= self.parameters.match:
            self._begin(gray, where)
        return best


def _best_match(gray: Gray, template: Gray, width: float) -> tuple[float, float, float]:
    """Return the best correlation of an image with a template of a width, and its column and row.

    The correlation is 0 if the image is smaller than the template.
    """
    if width < template.shape[1]:  # an enlarged image takes seconds and a gigabyte
        size = max(4, round(width)), max(4, round(template.shape[0] * width / template.shape[1]))
        template = cv2.resize(template, size, interpolation=cv2.INTER_AREA)
    height_there, width_there = template.shape
    scale = width_there / width
    size = round(gray.shape[1] * scale), round(gray.shape[0] * scale)
    if size[0] < width_there or size[1] < height_there:
        return 0.0, 0.0, 0.0
    small = cv2.resize(gray, size, interpolation=cv2.INTER_AREA)
    _, match, _, (column, row) = cv2.minMaxLoc(
        cv2.matchTemplate(small, template, cv2.TM_CCOEFF_NORMED)
    )
    return float(match), column / scale, row / scale
