"""Saves the last minute, loads a recording, and lets a person move through it."""

from __future__ import annotations

import math
import time
from typing import Any

import viser

from head_tracking.viewer.notify import by_person, notify
from head_tracking.viewer.observation import Observation, Outcome
from head_tracking.viewer.recording import Recorder, Recording, RecordingError

_STEP = 0.01  # s


class RecordingPanel:
    """Buttons to save, load, play and return to the robot; a slider through the recording."""

    def __init__(self, server: viser.ViserServer, recorder: Recorder) -> None:
        gui = server.gui
        self._gui = gui
        self._recorder = recorder
        self._recording: Recording | None = None
        self._playing_since: float | None = None
        save = gui.add_button("Save the last minute", icon=viser.Icon.DOWNLOAD)
        load = gui.add_upload_button("Load a recording", icon=viser.Icon.UPLOAD)
        now = gui.add_button("Replay the last minute", icon=viser.Icon.HISTORY)
        self._line = gui.add_html("")
        self._box = gui.add_folder("Recording", visible=False)
        with self._box:
            self._play = gui.add_button("Play / pause", icon=viser.Icon.PLAYER_PLAY)
            self._live = gui.add_button("Back to the robot", icon=viser.Icon.ROBOT)
        self._time: Any = None
        save.on_click(self._on_save)
        load.on_upload(self._on_load)
        now.on_click(lambda event: self._open(event, self._recorder.recording))
        self._play.on_click(lambda _: self._toggle())
        self._live.on_click(lambda _: self._close())

    def replayed(self) -> Observation | None:
        """What is to be shown instead of the robot; None: the robot."""
        recording, slider = self._recording, self._time
        if recording is None or slider is None:
            return None
        if self._playing_since is not None:
            at = time.monotonic() - self._playing_since
            if at > recording.duration:
                self._playing_since = time.monotonic()
                at = 0.0
            return recording.at(at)
        return recording.at(slider.value)

    def refresh(self) -> None:
        """Moves the slider along while it plays."""
        if self._playing_since is not None and self._time is not None:
            self._time.value = min(time.monotonic() - self._playing_since, self._time.max)

    def _on_save(self, event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
        try:
            recording = self._recorder.recording()
        except RecordingError as error:
            notify(event, Outcome(False, str(error)), "Save")
            return
        if event.client is not None:
            name = time.strftime("head-%Y%m%d-%H%M%S.json.gz")
            event.client.send_file_download(name, recording.to_bytes(), save_immediately=True)

    def _on_load(self, event: viser.GuiEvent[viser.GuiUploadButtonHandle]) -> None:
        file = event.target.value
        self._open(event, lambda: Recording.from_bytes(file.content))

    def _open(self, event: viser.GuiEvent[Any], read: Any) -> None:
        try:
            recording = read()
        except RecordingError as error:
            notify(event, Outcome(False, str(error)), "Recording")
            return
        self._close()
        with self._box:
            end = max(round(math.ceil(recording.duration / _STEP) * _STEP, 2), _STEP)
            self._time = self._gui.add_slider("Time (s)", 0.0, end, _STEP, 0.0, order=0.0)
        self._time.on_update(self._on_scrub)
        self._recording = recording
        self._box.visible = True
        notify(event, Outcome(True, f"{recording.duration:.1f} s are shown"), "Recording")

    def _on_scrub(self, event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
        if by_person(event):
            self._playing_since = None

    def _toggle(self) -> None:
        if self._time is not None:
            self._playing_since = (
                time.monotonic() - self._time.value if self._playing_since is None else None
            )

    def _close(self) -> None:
        self._recording, self._playing_since = None, None
        self._box.visible = False
        if self._time is not None:
            self._time.remove()
            self._time = None
