"""The summary of a run, also after a jump of the clock."""

import math
import re
from types import SimpleNamespace

import pytest

from head_tracking.gaze import PanTiltHead
from head_tracking.run.run_monitor import SETTLING_TIME, RunMonitor
from head_tracking.tracking import TargetState


class FakeControl:
    """A head at rest, and a target at a bearing [rad] from its axis."""

    joints = ("head_pan_joint", "head_tilt_joint")
    target = None

    def __init__(self, model):
        self.head = PanTiltHead(model, *self.joints, "camera_link")
        self.now = 1000.0
        self.bearing = 0.0
        self.code = TargetState.TRACKING
        self.has_points = True

    @property
    def frames(self):
        return self

    def state(self):
        return self.code, ""

    def take_recent(self):
        far = 1000.0
        if not self.has_points:
            return []
        return [(self.now, (far * math.cos(self.bearing), far * math.sin(self.bearing), 0.0))]


@pytest.fixture
def control(kinectbot):
    return FakeControl(kinectbot)


@pytest.fixture
def run(control):
    """Let seconds pass; return the largest error [degrees] and the judged time [s]."""
    steady = 0.0
    bus = SimpleNamespace(
        states={},
        statistics=SimpleNamespace(cycles=1, connected=True, servos=()),
        faults=0,
        in_short="",
    )
    monitor = RunMonitor(control, lambda: bus, lambda joint: 0.0, clock=lambda: steady)

    def run(seconds):
        nonlocal steady
        for _ in range(round(10 * seconds)):
            control.now += 0.1
            steady += 0.1
            monitor.update()
        match = re.search(r"([\d.]+)° max .* over (-?[\d.]+) s", monitor.summary())
        return match and tuple(map(float, match.groups()))

    return run


def test_a_target_that_was_given_up_is_not_judged(control, run):
    run(SETTLING_TIME + 5.0)
    control.code, control.has_points = TargetState.HOLDING, False
    assert run(5.0)[1] == pytest.approx(10.0, abs=1.2)
    control.code = TargetState.RECENTERING
    control.bearing = math.radians(76.0)
    largest, seconds = run(20.0)
    assert largest < 1.0
    assert seconds == pytest.approx(10.0, abs=1.2)
    control.code, control.has_points = TargetState.TRACKING, True
    largest, seconds = run(5.0)
    assert largest == pytest.approx(76.0, abs=1.0)
    assert seconds == pytest.approx(15.0, abs=1.6)
