import atexit
import threading
import time
from queue import Queue
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from image_encodings import COLOURLESS, ENCODERS, RawImage, raw

from head_tracking.vision import (
    Box,
    DepthImage,
    ImageError,
    NoPictureError,
    decode_depth,
    decode_picture,
    pictures,
)


@pytest.fixture(scope="module")
def picture():
    """Smooth colours: neighbours differ little, so that Bayer and YUV lose little."""
    v, u = np.mgrid[0:48, 0:64]
    blue, green, red = 60 + 2 * u, 40 + 3 * v, 200 - u - v
    return np.dstack((blue, green, red)).astype(np.uint8)


@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("padding", [0, 7])
@pytest.mark.parametrize("encoding", ENCODERS)
def test_every_usual_encoding_is_decoded(picture, encoding, padding, big_endian):
    numbers = ENCODERS[encoding](picture)
    found = decode_picture(raw(encoding, numbers, padding=padding, big_endian=big_endian)).bgr
    expected = picture
    if encoding in COLOURLESS:
        expected = np.repeat(ENCODERS["mono8"](picture)[..., None], 3, axis=2)
    inner = (slice(2, -2), slice(2, -2))
    allowed = 6 if "yu" in encoding or "yv" in encoding else 3 if "bayer" in encoding else 1
    worst = np.abs(found[inner].astype(int) - expected[inner]).max()
    assert worst <= allowed, (encoding, worst)


@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("padding", [0, 6])
@pytest.mark.parametrize(
    ("encoding", "numbers"),
    [
        ("16UC1", np.array([[1500, 0], [65535, 1]], np.uint16)),
        ("mono16", np.array([[1500, 0], [65535, 1]], np.uint16)),
        ("32FC1", np.array([[1.5, np.nan], [65.535, 0.001]], np.float32)),
    ],
)
def test_depths_are_metres_and_unknown_ones_are_nan(encoding, numbers, padding, big_endian):
    depth = decode_depth(raw(encoding, numbers, padding=padding, big_endian=big_endian))
    found = depth.metres()
    assert found == pytest.approx(np.array([[1.5, np.nan], [65.535, 0.001]]), rel=1e-6, nan_ok=True)
    assert depth.size == (2, 2)


def test_a_box_beyond_the_edge_gives_the_part_inside():
    depth = DepthImage(np.arange(1, 13, dtype=np.uint16).reshape(3, 4) * 1000)
    assert depth.part(Box(-2, -2, 3.5, 3)).tolist() == [[1.0, 2.0]]
    assert depth.part(Box(9, 9, 3, 3)).size == 0


@pytest.mark.parametrize("decode", [decode_picture, decode_depth])
def test_an_unknown_encoding_is_refused(decode):
    with pytest.raises(ImageError):
        decode(RawImage("rgb99", 2, 2, 6, bytes(12)))


@pytest.mark.parametrize(
    "image",
    [
        RawImage("bgr8", 4, 3, 12, bytes(35)),
        RawImage("bgr8", 4, 3, 11, bytes(36)),
        RawImage("bgr8", 4, 3, 0, bytes(36)),
        RawImage("bgr8", 4, 3, 12, b""),
        RawImage("bgr8", 0, 3, 0, b""),
        RawImage("bgr8", 4, 0, 12, b""),
        RawImage("bayer_rggb8", 1, 1, 1, b"1"),
        RawImage("yuv422", 3, 2, 6, bytes(12)),
        RawImage("mono16", 4, 3, 4, bytes(24)),
    ],
)
def test_damaged_images_are_refused(image):
    with pytest.raises(ImageError):
        decode_picture(image)


@pytest.mark.parametrize("encoding", ["bgr8", "mono8", "rgba8", "mono16"])
def test_an_image_of_one_pixel_is_an_image(encoding):
    numbers = ENCODERS[encoding](np.full((1, 1, 3), 80, np.uint8))
    picture = decode_picture(raw(encoding, numbers))
    assert picture.size == (1, 1)
    assert picture.gray.shape == (1, 1)
    assert picture.hsv.shape == (1, 1, 3)


def test_the_images_of_a_file_come_at_its_rate_and_end(tmp_path, monkeypatch):
    """Else what it shows would move many times as fast, and the head with it."""
    file = str(tmp_path / "film.avi")
    writer = cv2.VideoWriter(file, cv2.VideoWriter_fourcc(*"MJPG"), 20, (64, 48))
    for grey in range(10):
        writer.write(np.full((48, 64, 3), grey, np.uint8))
    writer.release()
    now = [100.0]
    clock = SimpleNamespace(
        time=lambda: now[0],
        monotonic=lambda: now[0],
        sleep=lambda period: now.append(now.pop() + period),
    )
    monkeypatch.setattr("head_tracking.vision.camera_follower.time", clock)
    stamps = [stamp for stamp, _ in pictures(file)]
    assert stamps == pytest.approx([100.0 + 0.05 * number for number in range(1, 11)])


class Stream(Queue):
    """A camera that keeps its images until they are read, as OpenCV does with URLs."""

    image = None

    def grab(self):
        if self.image is not None:
            self.task_done()
        self.image = super().get()
        return self.image != "end"

    def retrieve(self):
        return self.image != "damaged", self.image

    def get(self, _):
        return 0.0

    def release(self):
        self.image = None


def test_a_slow_program_gets_the_latest_image_of_a_camera(monkeypatch):
    """Else its images get older and older, and their times are those of their arrival."""
    stream = Stream()
    monkeypatch.setattr(cv2, "VideoCapture", lambda camera: stream)
    images = pictures("rtsp://camera")
    stream.put(1)
    assert next(images)[1] == 1
    for image in (2, 3, 4, 5, "damaged"):
        stream.put(image)
    while stream.unfinished_tasks > 1:  # an image is done at the next grab
        time.sleep(0.001)
    assert next(images)[1] == 5
    stream.put(6)
    stream.put("end")  # such as a plug that is pulled while the program is busy
    while any(thread.name == "images" for thread in threading.enumerate()):
        time.sleep(0.001)
    assert next(images)[1] == 6
    with pytest.raises(NoPictureError):
        next(images)
    assert stream.image is None  # released


def test_a_program_that_ends_ends_the_thread_of_its_camera_first(monkeypatch):
    """Else OpenCV aborts the process, after Ctrl-C, too."""
    stream, ends = Stream(), []
    monkeypatch.setattr(cv2, "VideoCapture", lambda camera: stream)
    monkeypatch.setattr(atexit, "register", ends.append)
    images = pictures("rtsp://camera")
    stream.put(1)
    assert next(images)[1] == 1
    stream.put(2)
    for end in ends:
        end()
    assert not any(thread.name == "images" for thread in threading.enumerate())
