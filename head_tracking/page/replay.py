"""Recordings that browsers replay."""

from __future__ import annotations

import secrets
import threading
from typing import IO, Any

from head_tracking.page.robot import Robot
from head_tracking.page.robot_shapes import RobotForBrowser
from head_tracking.recording.recording import Recording, RecordingError
from head_tracking.recording.recording_file import read_recording

_MOST = 6  # open recordings; then the one that was not used for the longest time is closed


class Replays:
    """The open recordings; for any thread. A key that is not open raises RecordingError."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._open: dict[str, tuple[Recording, RobotForBrowser]] = {}  # with what was recorded
        self._lock = threading.Lock()

    def open(self, file: IO[bytes]) -> dict[str, Any]:
        """Open a recording; return its key, duration, moments and robot for JSON.

        Raises:
            RecordingError: the file is damaged, or nothing of it can be shown.
        """
        recording = read_recording(file)
        key, (head, why) = secrets.token_urlsafe(9), self._robot.head_of(recording.model)
        robot = RobotForBrowser(recording.model, head, f"/head/replay/{key}/mesh/")
        with self._lock:
            self._open[key] = recording, robot
            for oldest in list(self._open)[:-_MOST]:
                del self._open[oldest]
        return {
            "key": key,
            "duration": recording.duration,
            "moments": [one._asdict() for one in recording.moments],
            "notice": "; ".join(filter(None, (recording.notice, why))),
            "pictures": bool(recording.pictures),
            "robot": robot.about,
        }

    def at(self, key: str, time: float) -> dict[str, Any]:
        """Return what was seen at a time [s] from the start, as a state for the browser."""
        recording, robot = self._used(key)
        seen = recording.at(time)
        return {
            "type": "state",
            **robot.state(seen),
            "word": "replay",
            "text": seen.text or "a recording",
        }

    def picture(self, key: str, time: float) -> bytes | None:
        """Return the latest JPEG or PNG before a time [s]; None without one."""
        return self._used(key)[0].picture_at(time)

    def meshes(self, key: str) -> tuple[bytes, ...]:
        """Return the meshes of the recorded robot."""
        return self._used(key)[1].meshes

    def _used(self, key: str) -> tuple[Recording, RobotForBrowser]:
        with self._lock:
            one = self._open.pop(key, None)
            if one is None:
                raise RecordingError("This recording was closed for others: open it again.")
            self._open[key] = one
        return one
