"""What a run says of itself at its end, whatever happened to the clock and the model meanwhile."""

import math
import re
from types import SimpleNamespace

import pytest

from head_tracking.gaze import PanTiltHead
from head_tracking.run.run_monitor import SETTLING, RunMonitor


class FakeControl:
    """A head that stands still, and its target at a bearing [rad] from where it looks."""

    joints = ("head_pan_joint", "head_tilt_joint")
    target = None

    def __init__(self, model):
        self.head = self._head(model)
        self.now = 1000.0
        self.bearing = 0.0

    @staticmethod
    def _head(model):
        return PanTiltHead(model, *FakeControl.joints, "camera_link")

    def describe(self, model):
        """Somebody publishes a robot_description, perhaps the same one."""
        self.head = self._head(model)

    def take_placed(self):
        far = 1000.0
        return [(self.now, (far * math.cos(self.bearing), far * math.sin(self.bearing), 0.0))]


@pytest.fixture
def control(kinectbot):
    return FakeControl(kinectbot)


@pytest.fixture
def run(control):
    """Let so many seconds go by; what is said at the end: max [degrees], over how long."""
    steady = [0.0]
    bus = SimpleNamespace(
        states={},
        statistics=SimpleNamespace(cycles=1, connected=True),
        faults=0,
        in_short="",
    )
    monitor = RunMonitor(control, lambda: bus, lambda joint: 0.0, clock=lambda: steady[0])

    def run(seconds):
        for _ in range(round(10 * seconds)):
            control.now += 0.1
            steady[0] += 0.1
            monitor.look()
        said = re.search(r"([\d.]+)° max .* over (-?[\d.]+) s", monitor.summary())
        return said and tuple(map(float, said.groups()))

    return run


def test_another_model_of_the_robot_makes_nothing_forgotten(control, run, kinectbot):
    control.bearing = math.radians(76.0)
    largest, seconds = run(SETTLING + 5.0)
    assert largest == pytest.approx(76.0, abs=1.0)
    assert seconds == pytest.approx(5.0, abs=0.3)
    control.bearing = 0.0
    control.describe(kinectbot)
    largest, seconds = run(SETTLING + 5.0)
    assert largest == pytest.approx(76.0, abs=1.0)
    assert seconds == pytest.approx(10.0, abs=0.6)


@pytest.mark.parametrize("jump", [-997.0, 3600.0])
def test_a_clock_that_jumps_changes_nothing_of_how_long_was_judged(control, run, jump):
    run(SETTLING + 5.0)
    control.now += jump
    _, seconds = run(SETTLING + 5.0)
    assert 5.0 <= seconds <= 12.5


def test_a_target_that_comes_just_before_the_end_is_not_judged(run):
    assert run(0.3) is None
