"""Traces of a pursuit: their figures, and the report of them."""

import math

import numpy as np
import pytest

from head_tracking.tracking import Sample, Trace, lag, table


def swing(behind=0.1, seconds=8.0, period=0.02, rate=2.0):
    trace = Trace()
    for k in range(int(seconds / period)):
        t = k * period
        wanted, pan = math.sin(rate * t), math.sin(rate * (t - behind))
        trace.add(Sample(t, (wanted, 0.1), (pan, 0.1), abs(wanted - pan)))
    return trace


def test_figures_of_a_swing():
    trace = swing(seconds=10.0, period=0.004, rate=1.0)
    assert trace.rms == pytest.approx(2 * math.sin(0.05) / math.sqrt(2), rel=0.1)
    assert trace.maximum == pytest.approx(2 * math.sin(0.05), rel=0.01)
    assert trace.jerk() == pytest.approx(2 / math.pi, rel=0.1)
    speeds = trace.velocities(trace.wanted)
    assert speeds[:, 0] == pytest.approx(np.cos(trace.times), abs=0.01)
    assert trace.within(0.2) == 1.0


@pytest.mark.parametrize("behind", [-0.05, 0.0, 0.1, 0.3])
def test_how_far_the_head_is_behind(behind):
    assert lag(swing(behind)) == pytest.approx(behind, abs=0.006)


def test_the_table_has_the_figures():
    text = table(swing(), [0.04, 0.06], 29.97)
    rows = dict(line.split("  ", 1) for line in text.splitlines())
    assert rows["target"].strip() == "30.0 points/s, 50 ms old"
    assert f"{1e3 * swing().rms:.1f} mrad" in text
    assert rows["head behind its target"].strip() == "100 ms"
    assert "2.00 rad/s for a target at 2.00" in text
