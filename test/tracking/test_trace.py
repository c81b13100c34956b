import math

import numpy as np
import pytest

from head_tracking.tracking import Sample, Trace


def swing(seconds=10.0, lag=0.1):
    times = np.arange(0.0, seconds, 0.004)
    return Trace(
        [
            Sample(
                t,
                (math.sin(t), 0.0),
                (math.sin(t - lag), 0.0),
                abs(math.sin(t) - math.sin(t - lag)),
            )
            for t in times.tolist()
        ]
    )


def test_figures_of_a_swing():
    recording = swing()
    assert recording.rms == pytest.approx(2 * math.sin(0.05) / math.sqrt(2), rel=0.1)
    assert recording.maximum == pytest.approx(2 * math.sin(0.05), rel=0.01)
    assert recording.jerk() == pytest.approx(2 / math.pi, rel=0.1)
    speeds = recording.velocities(recording.wanted)
    assert speeds[:, 0] == pytest.approx(np.cos(recording.times), abs=0.01)
    assert recording.within(0.2) == 1.0


def test_when_it_settled():
    samples = [
        Sample(t, (0, 0), (0, 0), error) for t, error in enumerate((0.5, 0.1, 0.3, 0.1, 0.1))
    ]
    assert Trace(samples).settled(0.2) == 3
    assert Trace(samples).settled(0.05) == math.inf
    assert Trace(samples).settled(0.9) == 0
