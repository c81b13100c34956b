"""Faces, by the cascades that come with OpenCV."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from head_tracking.exceptions import HeadTrackingError
from head_tracking.parameters import parameter
from head_tracking.vision.camera import Box
from head_tracking.vision.candidate import Candidate, Frame
from head_tracking.vision.opencv import cv2

_CASCADE = "haarcascade_frontalface_alt2.xml"
_FOLDERS = ("/usr/share/opencv4/haarcascades", "/usr/local/share/opencv4/haarcascades")
_SMALLEST = 20  # pixels: what the cascade was trained with
_TYPICAL_WEIGHT = 55.0
"""What the cascade's last stage gives to a clear face."""


@dataclass(frozen=True, slots=True)
class FaceParameters:
    """How thoroughly faces are looked for."""

    min_face: float = parameter(
        0.07, "Smallest face, as a share of the image's height.", minimum=0.01, maximum=1.0
    )
    search_period: int = parameter(
        5,
        "While a face is followed, the whole image is searched in every so many images, and the "
        "surroundings of known faces in the others.",
        unit="images",
        minimum=1,
        maximum=100,
    )
    min_neighbours: int = parameter(
        4, "How many overlapping finds make a face; more: fewer errors.", minimum=1, maximum=50
    )


class FaceDetector:
    """Finds faces that look about into the camera.

    Raises:
        HeadTrackingError: OpenCV came without its cascades.
    """

    def __init__(self, parameters: FaceParameters) -> None:
        self.parameters = parameters
        self._cascade = cv2.CascadeClassifier(str(_cascade_file()))
        self._since_search = 0

    def detect(self, frame: Frame, hints: Sequence[Box]) -> list[Candidate]:
        """Faces in the whole image, or, in most images, near those that are followed."""
        if frame.picture is None:
            return []
        gray = frame.picture.gray
        self._since_search += 1
        if not hints or self._since_search >= self.parameters.search_period:
            self._since_search = 0
            return self._search(gray, Box(0, 0, gray.shape[1], gray.shape[0]), None)
        found: list[Candidate] = []
        for hint in hints:
            for face in self._search(gray, hint.grown(2.2), hint.width):
                if not any(_same(face.box, other.box) for other in found):
                    found.append(face)
        return found

    def select(self, frame: Frame, box: Box) -> None:
        """Faces are chosen by whoever follows them."""

    def reset(self) -> None:
        """Looks everywhere again."""
        self._since_search = self.parameters.search_period

    def _search(
        self, gray: npt.NDArray[np.uint8], where: Box, width: float | None
    ) -> list[Candidate]:
        height = gray.shape[0]
        where = where.clipped(gray.shape[1], height)
        rows, columns = where.slices()
        part = gray[rows, columns]
        smallest = max(_SMALLEST, round(self.parameters.min_face * height))
        low = smallest if width is None else max(smallest, round(width * 0.65))
        if min(part.shape) <= low:
            return []
        boxes, _, weights = self._cascade.detectMultiScale3(
            part,
            scaleFactor=1.2,
            minNeighbors=self.parameters.min_neighbours,
            minSize=(low, low),
            maxSize=None if width is None else (round(width * 1.6),) * 2,
            outputRejectLevels=True,
        )
        return [
            self._candidate(
                Box(x + columns.start, y + rows.start, w, h), float(weight) / _TYPICAL_WEIGHT
            )
            for (x, y, w, h), weight in zip(
                np.reshape(boxes, (-1, 4)).tolist(), np.ravel(weights), strict=True
            )
        ]

    def _candidate(self, box: Box, confidence: float) -> Candidate:
        return Candidate(box, box.centre, min(1.0, max(0.0, confidence)))


def _same(a: Box, b: Box) -> bool:
    """Whether two boxes overlap by more than half of the smaller one."""
    width = min(a.x + a.width, b.x + b.width) - max(a.x, b.x)
    height = min(a.y + a.height, b.y + b.height) - max(a.y, b.y)
    smaller = min(a.width * a.height, b.width * b.height)
    return width > 0 and height > 0 and width * height > 0.5 * smaller


def _cascade_file() -> Path:
    shipped = getattr(cv2, "data", None)
    folders = ([shipped.haarcascades] if shipped else []) + list(_FOLDERS)
    for folder in folders:
        if (file := Path(folder) / _CASCADE).is_file():
            return file
    raise HeadTrackingError(
        f"OpenCV's face detector {_CASCADE} is in none of {', '.join(folders)}; install "
        "opencv-python-headless (pip) or opencv-data (apt)"
    )
