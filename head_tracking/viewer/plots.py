"""Numbers over time, as live plots in the control panel."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np

_SECONDS = 30.0


class ErrorPlot:
    """The error in degrees over the last half minute.

    Args:
        gui: viser's control panel, with the container open that gets the plot.
    """

    def __init__(self, gui: Any) -> None:
        self._samples: deque[tuple[float, float]] = deque()
        self._plot = gui.add_uplot(
            data=(np.array([-_SECONDS, 0.0]), np.array([np.nan, np.nan])),
            series=(
                {"label": "seconds"},
                {"label": "error (degrees)", "stroke": "#c2255c", "width": 2},
            ),
            # a fixed axis: the client loses one that has to follow negative times
            scales={"x": {"time": False, "range": (-_SECONDS, 0.0)}, "y": {"auto": True}},
            title="Error (degrees) over the last seconds",
            aspect=1.9,
        )

    def add(self, now: float, error: float | None) -> None:
        """Takes the error [rad] at a time [s]; None: there is no target."""
        samples = self._samples
        if samples and now <= samples[-1][0]:
            return
        samples.append((now, math.nan if error is None else math.degrees(error)))
        while now - samples[0][0] > _SECONDS:
            samples.popleft()
        if len(samples) > 1:
            # arrays of their own: viser sends the memory as it lies there
            times = np.array([time - now for time, _ in samples])
            self._plot.data = (times, np.array([error for _, error in samples]))
