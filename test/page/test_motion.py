"""An observation as the browser gets it."""

import pytest

from head_tracking.page.motion import Motion
from head_tracking.recording.recording import Observation


def test_a_target_has_the_time_at_which_it_was_there(robot):
    motion = Motion(robot, None)
    seen = motion.of(Observation(2_000_000_000, target=(2.0, 1.0, 1.0), target_stamp=1_700_000_000))
    assert seen["stamp"] == 2.0
    assert seen["target_stamp"] == pytest.approx(1.7)
    assert motion.of(Observation(2_000_000_000))["target_stamp"] is None
