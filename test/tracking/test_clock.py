"""Clocks that jump, stand still and start anew; in simulated time."""

import math

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from ideal_head import DT, IdealHead
from runs import HEAD

from head_tracking.tracking import LAWS, ClockWatch, Tracker


class Clocks:
    """One clock that can be set, and one that never jumps."""

    def __init__(self, now=10_000.0):
        self.now, self.steady = now, 50.0

    def go(self, seconds, speed=1.0):
        self.now, self.steady = self.now + speed * seconds, self.steady + seconds


def test_a_clock_that_is_being_slewed_has_not_jumped():
    clocks = Clocks()
    watch = ClockWatch(lambda: clocks.now, lambda: clocks.steady)
    for _ in range(1000):
        clocks.go(DT, speed=1.0005)
        assert watch.check(simulated=False) == ""


def test_a_thread_that_is_interrupted_between_two_looks_has_seen_no_jump():
    clocks = Clocks()
    pauses = iter([0.0, 0.0, 0.3, 0.0, 0.0] + [0.0] * 10)

    def clock():
        now = clocks.now
        clocks.go(next(pauses))
        return now

    watch = ClockWatch(clock, lambda: clocks.steady)
    for _ in range(8):
        clocks.go(DT)
        assert watch.check(simulated=False) == ""


class Rig(IdealHead):
    """A tracker as `Head` wires it, on a clock that can be set."""

    def __init__(self, law):
        super().__init__(Tracker(HEAD, LAWS[law](HEAD, DT)), 1e6)
        self.steady = 50.0
        self.watch = ClockWatch(lambda: self.now, lambda: self.steady)

    def look(self, target=None):
        """One period."""
        self.now, self.steady = self.now + DT, self.steady + DT
        happened = self.watch.check(simulated=False)
        if happened:
            self.obey(self.tracker.reset(happened))
        self.now -= DT
        self.run(DT, target)


class AnyOrder(RuleBasedStateMachine):
    """Jumps, targets, switches and servos in any order: nothing moves that nobody asked for."""

    @initialize(law=st.sampled_from(sorted(LAWS)))
    def begin(self, law):
        self.rig = Rig(law)
        self.asked = False

    @rule(azimuth=st.floats(-1.5, 1.5), count=st.integers(1, 25))
    def see(self, azimuth, count):
        for _ in range(count):
            self.rig.look((2.0 * math.cos(azimuth), 2.0 * math.sin(azimuth), 0.2))
        self.asked = True

    @rule(count=st.integers(1, 40))
    def see_nothing(self, count):
        self.quietly(count)

    @rule(jump=st.sampled_from([-3600.0, -2.0, -0.3, 0.3, 2.0, 3600.0]))
    def jump(self, jump):
        self.rig.now += jump
        self.rig.look()
        self.asked = False
        self.quietly(10)

    @rule()
    def restart(self):
        command = self.rig.tracker.restart()
        if command is not None:  # else no time passes
            self.rig.obey(command)
        self.asked = False

    @rule()
    def recenter(self):
        self.rig.tracker.recenter()
        self.asked = True

    @rule(obeys=st.booleans())
    def servos(self, obeys):
        self.rig.obeys = obeys

    def quietly(self, count):
        before = tuple(self.rig.positions)
        for _ in range(count):
            self.rig.look()
        if not self.asked:
            assert tuple(self.rig.positions) == pytest.approx(before, abs=0.11)

    @invariant()
    def inside(self):
        rig = self.rig
        assert rig.farthest <= 5.0 * DT + 1e-9
        for position, limits in zip(
            rig.positions, (HEAD.pan_limits, HEAD.tilt_limits), strict=True
        ):
            assert limits.lower - 1e-9 <= position <= limits.upper + 1e-9


TestAnyOrder = AnyOrder.TestCase
TestAnyOrder.settings = settings(max_examples=25, stateful_step_count=20)
