"""Records everything, keeps the last minute, and lets a person move through a recording."""

from __future__ import annotations

import io
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import viser
from PIL import Image

from head_tracking.recording.recorder import Recorder
from head_tracking.recording.recording import LastMinute, Observation, Recording, RecordingError
from head_tracking.recording.recording_file import read_recording, write_recording
from head_tracking.ros.kit.other_services import Hold, Outcome
from head_tracking.transforms import RobotModel, RobotModelError, parse_robot_model
from head_tracking.viewer.notify import by_person, follow, notify, small
from head_tracking.viewer.other_topics import Picture

_STEP = 0.01  # s
_MOST_MARKS = 60
_LARGEST_DOWNLOAD = 200_000_000  # bytes: viser holds them in memory
_SPEEDS = {"0.25 x": 0.25, "0.5 x": 0.5, "1 x": 1.0, "2 x": 2.0, "5 x": 5.0, "20 x": 20.0}
_RECORDED = 10**9
"""The robot's own pictures have smaller numbers."""

_NO_FILE = "(none yet)"
_NOWHERE = "..."
_HELD = "a recording is shown, and nothing is commanded meanwhile: press Back to the robot first"


class RecordingPanel:
    """Buttons to record, save, load and replay; a time line through what is replayed.

    Args:
        server: gets the inputs, in the container that is open now.
        last_minute: what the page has seen.
        recorder: writes everything into files.
        hold: keeps commands back while a recording is shown.
        model: the robot's model now.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        last_minute: LastMinute,
        recorder: Recorder,
        hold: Hold,
        model: Callable[[], RobotModel | None],
    ) -> None:
        gui = self._gui = server.gui
        self._last_minute = last_minute
        self._recorder = recorder
        self._hold = hold
        self._live_model = model
        self._recording: Recording | None = None
        self._model: RobotModel | None = None
        self._place = 0.0
        self._playing_since: float | None = None
        self._record = gui.add_button(
            "Record everything", icon=viser.Icon.PLAYER_RECORD,
            hint="All topics of this robot into one MCAP file on the robot's side, for Foxglove, "
            "ros2 bag and this page.",
        )  # fmt: skip
        self._status = gui.add_html("")
        self._file = gui.add_dropdown("Recordings", [_NO_FILE], hint=f"In {recorder.directory}.")
        replay = gui.add_button("Replay", icon=viser.Icon.PLAYER_PLAY)
        download = gui.add_button("Download", icon=viser.Icon.DOWNLOAD)
        save = gui.add_button("Save the last minute", icon=viser.Icon.DOWNLOAD)
        now = gui.add_button("Replay the last minute", icon=viser.Icon.HISTORY)
        load = gui.add_upload_button("Load a recording", icon=viser.Icon.UPLOAD)
        self._box = gui.add_folder("Replay", visible=False)
        with self._box:
            self._about = gui.add_html("", order=0.0)
            self._play = gui.add_button("Play / pause", icon=viser.Icon.PLAYER_PLAY, order=2.0)
            self._speed = gui.add_dropdown("Speed", tuple(_SPEEDS), initial_value="1 x", order=3.0)
            self._moments = gui.add_dropdown(
                "Go to",
                [_NOWHERE],
                order=4.0,
                hint="STOP, faults, and what was switched on or off.",
            )
            live = gui.add_button("Back to the robot", icon=viser.Icon.ROBOT, order=5.0)
        self._time: Any = None
        self._record.on_click(self._on_record)
        replay.on_click(self._on_replay)
        download.on_click(self._on_download)
        save.on_click(self._on_save)
        now.on_click(lambda event: self._open(event, self._seen_now))
        load.on_upload(self._on_load)
        self._play.on_click(lambda _: self._toggle())
        self._speed.on_update(lambda _: self._go(self._now()))
        self._moments.on_update(self._on_moment)
        live.on_click(lambda _: self.close())

    @property
    def model(self) -> RobotModel | None:
        """The model of the robot that is replayed, if it is another one than is there."""
        return self._model

    def replayed(self) -> Observation | None:
        """What is to be shown instead of the robot; None: the robot."""
        recording = self._recording
        return None if recording is None else recording.at(self._now())

    def camera(self) -> str:
        """The topic of the pictures in the recording that is shown; empty: there are none."""
        recording = self._recording
        return "" if recording is None else recording.camera

    def picture(self) -> Picture | None:
        """What the camera saw, in the recording that is shown; for any thread."""
        recording = self._recording
        found = None if recording is None else recording.picture_at(self._now())
        if found is None:
            return None
        index, picture = found
        try:
            with Image.open(io.BytesIO(picture.data)) as opened:
                pixels = np.asarray(opened.convert("RGB"))
        except (OSError, ValueError, Image.DecompressionBombError):
            return None  # damaged, or of a kind that is not known
        return Picture(_RECORDED + index, picture.stamp, picture.frame_id, pixels, None)

    def refresh(self) -> None:
        """Moves the time line along while it plays; tells how the recorder does."""
        recording = self._recording
        if recording is not None and self._time is not None:
            now = self._now()
            if now >= recording.duration:
                self._playing_since, self._place = None, recording.duration
            self._time.value = min(now, self._time.max)
        runs = self._recorder.file is not None
        self._record.label = "End recording" if runs else "Record everything"
        self._record.color = "red" if runs else None
        self._status.content = small(self._recorder.status)
        names = tuple(file.name for file in self._recorder.files()) or (_NO_FILE,)
        follow(self._file, names, names[0])

    def close(self) -> None:
        """Shows the robot again."""
        self._hold.reason = ""
        self._recording, self._model, self._playing_since = None, None, None
        self._box.visible = False
        if self._time is not None:
            self._time.remove()
            self._time = None

    def _on_record(self, event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
        runs = self._recorder.file is not None
        notify(event, self._recorder.stop() if runs else self._recorder.start(), "Record")

    def _on_replay(self, event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
        self._open(event, self._read_file)

    def _read_file(self) -> Recording:
        try:
            with self._chosen().open("rb") as file:
                return read_recording(file)
        except OSError as error:
            raise RecordingError(f"it can't be read: {error}") from error

    def _chosen(self) -> Path:
        """The recording of the menu, and no other file, whatever a browser says is chosen.

        Raises:
            FileNotFoundError: it is not there.
        """
        for file in self._recorder.files():
            if file.name == self._file.value:
                return file
        raise FileNotFoundError(f"there is no such recording in {self._recorder.directory}")

    def _on_download(self, event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
        try:
            file = self._chosen()
            size = file.stat().st_size
            if size > _LARGEST_DOWNLOAD:
                raise OSError(f"{size / 1e6:.0f} MB are too much for the page; copy {file}")
            content = file.read_bytes()
        except OSError as error:
            notify(event, Outcome(False, str(error)), "Download")
            return
        if event.client is not None:
            event.client.send_file_download(file.name, content, save_immediately=True)

    def _seen_now(self) -> Recording:
        model = self._live_model()
        return self._last_minute.recording("" if model is None else model.urdf)

    def _on_save(self, event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
        try:
            content = write_recording(self._seen_now())
        except RecordingError as error:
            notify(event, Outcome(False, str(error)), "Save")
            return
        if event.client is not None:
            name = time.strftime("head-%Y%m%d-%H%M%S-last-minute.mcap")
            event.client.send_file_download(name, content, save_immediately=True)

    def _on_load(self, event: viser.GuiEvent[viser.GuiUploadButtonHandle]) -> None:
        content = event.target.value.content
        self._open(event, lambda: read_recording(io.BytesIO(content)))

    def _open(self, event: viser.GuiEvent[Any], read: Callable[[], Recording]) -> None:
        client = event.client
        reading = client and client.add_notification(
            "Replay", "is read: half a minute for each hour", loading=True, with_close_button=False
        )
        try:
            recording = read()
            live = self._live_model()
            other = recording.urdf and (live is None or live.urdf != recording.urdf)
            model = parse_robot_model(recording.urdf) if other else None
        except (RecordingError, RobotModelError) as error:
            notify(event, Outcome(False, str(error)), "Recording")
            return
        finally:
            if reading is not None:
                reading.remove()
        self.close()
        end = max(round(math.ceil(recording.duration / _STEP) * _STEP, 2), _STEP)
        moments = recording.moments
        with self._box:
            self._time = self._gui.add_slider(
                "Time (s)", 0.0, end, _STEP, 0.0, order=1.0,
                marks=tuple(moment.time for moment in moments[:_MOST_MARKS]) or None,
            )  # fmt: skip
        self._time.on_update(self._on_scrub)
        self._moments.options = (_NOWHERE, *(f"{one.time:.1f} s: {one.text}" for one in moments))
        self._moments.visible = bool(moments)
        name = f"a recording of {model.name}" if model is not None else "a recording of this robot"
        said = f"{name}, {recording.duration:.1f} s" + (
            f": {recording.notice}" if recording.notice else ""
        )
        self._about.content = small(said)
        self._hold.reason = _HELD
        self._place = 0.0
        self._recording, self._model = recording, model
        self._box.visible = True
        notify(event, Outcome(True, said), "Replay")

    def _now(self) -> float:
        """The place on the time line [s]."""
        since, recording = self._playing_since, self._recording
        if since is None or recording is None:
            return self._place
        played = (time.monotonic() - since) * _SPEEDS.get(self._speed.value, 1.0)
        return min(self._place + played, recording.duration)

    def _go(self, place: float) -> None:
        """Goes to a place, and on from there if it plays."""
        self._place = place
        if self._playing_since is not None:
            self._playing_since = time.monotonic()

    def _on_scrub(self, event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
        if by_person(event) and math.isfinite(event.target.value):
            self._playing_since, self._place = None, max(0.0, event.target.value)

    def _on_moment(self, event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
        recording = self._recording
        if by_person(event) and recording is not None and event.target.value != _NOWHERE:
            self._go(recording.moments[event.target.options.index(event.target.value) - 1].time)

    def _toggle(self) -> None:
        recording, now = self._recording, self._now()
        if recording is None:
            return
        if self._playing_since is not None:
            self._playing_since, self._place = None, now
            return
        self._place = 0.0 if now >= recording.duration else now
        self._playing_since = time.monotonic()
