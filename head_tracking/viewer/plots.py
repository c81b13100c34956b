"""Numbers over time, as live plots in the control panel."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from head_tracking.gaze import PanTiltHead
from head_tracking.recording.recording import Observation
from head_tracking.transforms import RobotModel

_SECONDS = 30.0
_LEAST = 0.09  # s between samples
_PAN, _TILT = "#1971c2", "#2f9e44"

GAZE: Sequence[Mapping[str, Any]] = (
    {"label": "pan", "stroke": _PAN, "width": 2},
    {"label": "pan wanted", "stroke": _PAN, "width": 1, "dash": (4, 4)},
    {"label": "tilt", "stroke": _TILT, "width": 2},
    {"label": "tilt wanted", "stroke": _TILT, "width": 1, "dash": (4, 4)},
)
ERROR: Sequence[Mapping[str, Any]] = (
    {"label": "error (degrees)", "stroke": "#c2255c", "width": 2},
)


class Strip:
    """Some angles in degrees over the last half minute.

    Args:
        gui: viser's control panel, with the container open that gets the plot.
        title: what it shows.
        series: label and looks of each angle.
    """

    def __init__(self, gui: Any, title: str, series: Sequence[Mapping[str, Any]]) -> None:
        self._samples: deque[tuple[float, ...]] = deque()
        nothing = np.array([np.nan, np.nan])
        self._plot = gui.add_uplot(
            data=(np.array([-_SECONDS, 0.0]), *(nothing for _ in series)),
            series=({"label": "seconds"}, *series),
            # a fixed axis: the client loses one that has to follow negative times
            scales={"x": {"time": False, "range": (-_SECONDS, 0.0)}, "y": {"auto": True}},
            title=title,
            aspect=1.9,
        )

    def add(self, now: float, angles: Sequence[float | None]) -> None:
        """Takes angles [rad] at a time [s]; None: there is none."""
        samples = self._samples
        if samples and now < samples[-1][0]:
            samples.clear()  # the clock was set back
        if samples and now - samples[-1][0] < _LEAST:
            return
        samples.append((now, *(math.nan if one is None else math.degrees(one) for one in angles)))
        while now - samples[0][0] > _SECONDS:
            samples.popleft()

    def draw(self) -> None:
        """Shows what it has."""
        if len(self._samples) > 1:
            now = self._samples[-1][0]
            # arrays of their own: viser sends the memory as it lies there
            times, *angles = (np.array(column) for column in zip(*self._samples, strict=True))
            self._plot.data = (times - now, *angles)


def wanted_gaze(
    model: RobotModel | None, head: PanTiltHead | None, live: Observation
) -> tuple[float | None, float | None]:
    """Pan and tilt [rad] that look at the target, or come nearest to it; None without one."""
    if model is None or head is None or live.target is None:
        return None, None
    standing = dict.fromkeys(model.independent_joints, 0.0)
    target = model.transform(model.root, head.base_frame, standing).inverse() @ live.target
    positions = (live.joints.get(joint, 0.0) for joint in (head.pan_joint, head.tilt_joint))
    gaze = head.gaze(target, *positions)
    return gaze.pan, gaze.tilt
