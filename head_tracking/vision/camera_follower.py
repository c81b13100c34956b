"""Follow a detected object with a head, without ROS."""

from __future__ import annotations

import atexit
import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from head_tracking.exceptions import (
    FrameError,
    HeadTrackingError,
    RefusedCommandError,
    SupersededError,
)
from head_tracking.parameters import check_kind, verified
from head_tracking.transforms import Transform, Vector3
from head_tracking.vision.camera import Camera, camera_with_view
from head_tracking.vision.candidate import Detector, Frame
from head_tracking.vision.identity import IdentityParameters
from head_tracking.vision.images import ImageError, Picture, Pixels
from head_tracking.vision.opencv import cv2
from head_tracking.vision.visual_tracker import DistanceParameters, Sighting, VisualTracker

_LOG = logging.getLogger(__name__)
_END_TIMEOUT = 2.0  # s
_UNUSABLE = 5.0  # s for which images may be older than what is known of the head
_USUAL_RATE, _FASTEST_RATE = 30.0, 240.0  # images a second, of a file that does not tell

DEFAULT_VIEW = math.radians(60.0)
"""Horizontal field of view of many webcams [rad]."""


class NoPictureError(HeadTrackingError):
    """A camera cannot be opened, or delivers no more images.

    Attributes:
        camera: its number or name.
    """

    def __init__(self, camera: int | str) -> None:
        super().__init__(
            f"no image from the camera {camera!r}; allowed are a number (0: the first camera), the "
            "name of a device or a file, and a URL; no other program may use the device"
        )
        self.camera = camera


def pictures(camera: int | str) -> Generator[tuple[float, Pixels]]:
    """Yield the images of a camera with their times of arrival [s, as time.time()].

    Those of a file come at its own rate, and then end. Of a camera, images that come while the
    program is busy are dropped, but the latest one.

    Args:
        camera: number, device, file or URL, as for OpenCV's VideoCapture.

    Raises:
        NoPictureError: the camera delivers no image, or no more; the file has none.
        OpenCVMissingError: OpenCV is not installed.
    """
    if isinstance(camera, int) and camera < 0:  # OpenCV crashes at -1 if there is no camera
        raise NoPictureError(camera)
    capture = cv2.VideoCapture(camera)
    is_path = isinstance(camera, str) and Path(camera).is_file()
    is_file = is_path or capture.get(cv2.CAP_PROP_FRAME_COUNT) > 0.0  # a URL may be a file, too
    rate = capture.get(cv2.CAP_PROP_FPS)
    period = 1.0 / (rate if 1.0 <= rate <= _FASTEST_RATE else _USUAL_RATE)
    images, has_ended = _grabbed(capture, period if is_file else None), False
    try:
        for image in images if is_file else _latest(images):
            yield image
            has_ended = is_file
    finally:
        capture.release()
    if not has_ended:
        raise NoPictureError(camera)


def _grabbed(capture: Any, period: float | None) -> Generator[tuple[float, Pixels]]:
    """Yield all images with their times [s]; period: between those of a file [s]."""
    due = time.monotonic()
    while capture.grab():
        if period is not None:
            due += period
            time.sleep(max(0.0, due - time.monotonic()))
        stamp = time.time()
        good, picture = capture.retrieve()
        if good:
            yield stamp, picture


def _latest(images: Generator[tuple[float, Pixels]]) -> Generator[tuple[float, Pixels]]:
    """Yield the latest image; a thread receives all: those that wait get a wrong time."""
    latest: deque[tuple[float, Pixels]] = deque(maxlen=1)
    came, ending = threading.Event(), threading.Event()

    def receive() -> None:
        try:
            for image in images:
                latest.append(image)
                came.set()
                if ending.is_set():
                    break
        finally:
            ending.set()
            came.set()

    def end() -> None:
        ending.set()
        thread.join(_END_TIMEOUT)

    thread = threading.Thread(target=receive, name="images", daemon=True)
    atexit.register(end)  # a process that ends while a thread is in OpenCV is aborted
    thread.start()
    try:
        while not ending.is_set() or latest:
            came.wait()
            came.clear()
            if latest:
                yield latest.pop()
    finally:
        atexit.unregister(end)
        ending.set()
        thread.join()


def checked_pictures(
    camera: int | str | Iterable[tuple[float, Pixels]],
) -> Generator[tuple[float, Pixels]]:
    """Return the images of a camera, or those that a program yields; check these.

    Raises:
        TypeError: it is neither a camera nor an iterable.
        ImageError: while they are read: an image cannot be used, or its time is not finite.
        NoPictureError: likewise; see `pictures`.
    """
    try:
        if isinstance(camera, bool):
            raise TypeError
        if isinstance(camera, int | str):
            return pictures(camera)
        return _checked(iter(camera))
    except TypeError:
        raise TypeError(
            f"the camera is {camera!r}; give a number, the name of a device or a file, a URL, or "
            "pairs of time and image"
        ) from None


def _checked(source: Iterator[tuple[float, Pixels]]) -> Generator[tuple[float, Pixels]]:
    for item in source:
        try:
            stamp, picture = item
            stamp = float(stamp)
        except (TypeError, ValueError):
            raise ImageError(
                "an image has no time; give pairs of a time [s], as time.time() returns it, and an "
                "image"
            ) from None
        shape, kind = np.shape(picture), getattr(picture, "dtype", type(picture).__name__)
        if kind != np.uint8 or len(shape) != 3 or shape[2] != 3 or 0 in shape:
            raise ImageError(
                f"an image has the type {kind} and the shape {shape}; give numpy arrays of uint8, "
                "shape (height, width, 3): blue, green, red"
            )
        if not math.isfinite(stamp):
            raise ImageError(f"the time of an image is {stamp}; give seconds, as time.time() does")
        yield stamp, picture


class CameraFollower:
    """Passes detected points to a head, in a thread; logs a warning if it fails.

    Args:
        detector: detects the object; without a selection that it needs, a warning is logged.
        source: images (blue, green, red; shape (height, width, 3)) with their times [s, as
            time.time()].
        check: raises an error that ends the thread; called for each image, and after another error,
            which may be its effect.
        follow: receives each point in the optical frame [m], and its time [s].
        pose: returns `T_fixed_optical` at the time of each image [s]; may block until it is known.
            An image without it is not used; after 5 s of such images the thread ends.
        camera: the camera; None: one with `DEFAULT_VIEW`.
        distances: limits and assumption of the distance; None: 2 m where it is not measured.

    Attributes:
        sighting: the target in the latest image; None: not detected there.
        error: the exception that ended the thread; None: none.
    """

    def __init__(
        self,
        detector: Detector,
        source: Generator[tuple[float, Pixels]],
        check: Callable[[], object],
        follow: Callable[[Vector3, float], object],
        pose: Callable[[float], Transform],
        camera: Camera | None = None,
        distances: DistanceParameters | None = None,
    ) -> None:
        check_kind(camera, Camera)
        check_kind(distances, DistanceParameters)
        if not detector.has_selection:
            name = type(detector).__name__
            _LOG.warning("%s detects nothing before its select(frame, box) is called", name)
        self.sighting: Sighting | None = None
        self.error: Exception | None = None
        self._tracker = VisualTracker(
            detector,
            verified(distances or DistanceParameters(distance=2.0)),
            IdentityParameters(),
        )
        self._source, self._check, self._camera = source, check, camera
        self._follow, self._pose = follow, pose
        self._ending, self._usable = False, time.monotonic()
        self._unusable: FrameError | None = None
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        atexit.register(self._end)  # as in `_latest`
        self._thread.start()

    def wait(self, timeout: float | None = None) -> bool:
        """Wait for the end of the thread, at most for a time [s]; return whether it has ended."""
        self._thread.join(timeout)
        return not self._thread.is_alive()

    def close(self) -> None:
        """Stop after the present image."""
        self._ending = True

    def _end(self) -> None:
        self.close()
        self.wait(_END_TIMEOUT)

    def _run(self) -> None:
        try:
            with closing(self._source):  # the next one may use the same camera
                for stamp, picture in self._source:
                    if self._ending:
                        return
                    self._check()
                    self._process(stamp, picture)
            if self._unusable is not None:
                raise self._unusable
        except Exception as failure:  # a source or a detector may raise anything
            error = self.error = self._reason(failure)
            if not isinstance(error, RefusedCommandError | SupersededError):
                is_ours = isinstance(error, HeadTrackingError)
                _LOG.warning(
                    "the camera is not followed any more: %s",
                    error if is_ours else repr(error),
                    exc_info=not is_ours,
                )
        finally:
            atexit.unregister(self._end)

    def _reason(self, error: Exception) -> Exception:
        try:
            self._check()
        except HeadTrackingError as reason:
            return reason
        return error

    def _process(self, stamp: float, picture: Pixels) -> None:
        height, width, _ = picture.shape
        camera = self._camera or camera_with_view(width, height, DEFAULT_VIEW)
        frame = Frame(round(stamp * 1e9), camera, Picture(picture), None)
        try:
            pose = self._pose(stamp)
        except FrameError as error:
            if time.monotonic() - self._usable > _UNUSABLE:
                raise
            self.sighting, self._unusable = None, error
            return
        self._usable, self._unusable = time.monotonic(), None
        self.sighting = self._tracker.step(frame, pose)
        if self.sighting is not None and not self._ending:
            self._follow(self.sighting.point, stamp)
