"""Recordings that browsers replay, each on a time line of its own."""

from __future__ import annotations

import json
import secrets
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from head_tracking.gaze import PanTiltHead
from head_tracking.page.robot_shapes import RobotForBrowser
from head_tracking.page.sample import motion_of
from head_tracking.recording.recording import LastMinute, Recording, RecordingError
from head_tracking.recording.recording_file import read_recording, write_recording
from head_tracking.transforms import RobotModel, RobotModelError, parse_robot_model

_MOST = 6
_MOST_MOMENTS = 500

HeadOf = Callable[[RobotModel], PanTiltHead | None]


@dataclass(frozen=True, slots=True)
class Replayed:
    """An open recording.

    Attributes:
        recording: what was seen.
        model: of the robot that was seen.
        head: of that robot, if it has one.
        shapes: of that robot, for the browser.
    """

    recording: Recording
    model: RobotModel
    head: PanTiltHead | None
    shapes: RobotForBrowser


class Replays:
    """The recordings that are open; the oldest is closed where there are too many. For any thread.

    Args:
        last_minute: what the page has seen.
        model: returns the robot's model now.
        head_of: returns the head of a model.
        describe: returns a robot for the browser.
    """

    def __init__(
        self,
        last_minute: LastMinute,
        model: Callable[[], RobotModel | None],
        head_of: HeadOf,
        describe: Callable[[RobotModel, PanTiltHead | None, str], RobotForBrowser],
    ) -> None:
        self._last_minute = last_minute
        self._model = model
        self._head_of = head_of
        self._describe = describe
        self._open: dict[str, Replayed] = {}
        self._lock = threading.Lock()

    def last_minute(self) -> bytes:
        """Return the last minute as an MCAP file.

        Raises:
            RecordingError: nothing has been seen.
        """
        return write_recording(self._seen_now())

    def open_last_minute(self) -> dict[str, Any]:
        """Open what the page has seen in the last minute; see `open_file`."""
        return self._opened(self._seen_now())

    def open_file(self, file: Path | IO[bytes]) -> dict[str, Any]:
        """Open a recording; return its key, duration [s], moments and robot for JSON.

        Raises:
            RecordingError: the file can't be read, or has no model of the robot.
        """
        try:
            if isinstance(file, Path):
                with file.open("rb") as stream:
                    return self._opened(read_recording(stream))
            return self._opened(read_recording(file))
        except OSError as error:
            raise RecordingError(f"The file can't be read: {error}") from error

    def at(self, key: str, time: float) -> str:
        """Return what was seen at a time [s] from the start, as a state for the browser.

        Raises:
            KeyError: the recording is not open any more.
        """
        one = self._open[key]
        seen = one.recording.at(time)
        return json.dumps(
            {"type": "state", **motion_of(seen, one.model, one.head), "boxes": []}
            | {"word": "replay", "text": seen.state or "a recording", "time": time}
        )

    def picture(self, key: str, time: float) -> bytes | None:
        """Return the JPEG or PNG that the camera saw last; None if it saw nothing.

        Raises:
            KeyError: the recording is not open any more.
        """
        found = self._open[key].recording.picture_at(time)
        return None if found is None else found[1].data

    def mesh(self, key: str, number: int) -> bytes:
        """Return a mesh of the recorded robot, binary STL.

        Raises:
            LookupError: there is none.
        """
        return self._open[key].shapes.meshes[number]

    def _seen_now(self) -> Recording:
        model = self._model()
        return self._last_minute.recording("" if model is None else model.urdf)

    def _opened(self, recording: Recording) -> dict[str, Any]:
        try:
            model = parse_robot_model(recording.urdf) if recording.urdf else self._model()
        except RobotModelError as error:
            raise RecordingError(f"The recorded robot can't be read: {error}") from error
        if model is None:
            raise RecordingError("The recording has no robot model, and none has been received.")
        key, head = secrets.token_urlsafe(9), self._head_of(model)
        shapes = self._describe(model, head, f"/head/replay/{key}/mesh/")
        with self._lock:
            self._open[key] = Replayed(recording, model, head, shapes)
            for old in list(self._open)[:-_MOST]:
                del self._open[old]
        return {
            "key": key,
            "duration": recording.duration,
            "moments": [
                {"time": one.time, "text": one.text} for one in recording.moments[:_MOST_MOMENTS]
            ],
            "notice": recording.notice,
            "pictures": bool(recording.pictures),
            "robot": shapes.about,
        }
