"""Whatever comes as a target: commands stay inside the limits, and the head ends at rest."""

import math

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from ideal_head import IdealHead
from runs import HEAD

from head_tracking.tracking import (
    LAWS,
    PredictiveLawParameters,
    SpeedLimits,
    Target,
    TargetPlacer,
    TargetStateParameters,
    Tracker,
)
from head_tracking.transforms import TransformBuffer

SECOND = 1_000_000_000
START = 1_000 * SECOND
PERIOD = SECOND // 50
TICK = 0.00511
NAN = math.nan
MOST_SETTLING = 16  # s: the longest turn at 0.8 rad/s, and a correction every second after it

coordinates = st.one_of(st.floats(-5.0, 5.0), st.sampled_from([0.0, 1e-6, 1e9, NAN, math.inf]))
points = st.tuples(coordinates, coordinates, coordinates)
frames = st.sampled_from(
    ["head_pan_link", "base_link", "camera_optical_frame", "head_link", "gripper", ""]
)
ages = st.one_of(
    st.floats(-0.05, 0.3), st.sampled_from([0.0, 60.0, -0.2, -30.0, 0.9]), st.just(None)
)
readings = st.sampled_from([None, None, NAN, math.inf, -math.inf, 1e300])
gaps = st.one_of(st.just(0.03), st.floats(0.0, 0.3), st.sampled_from([0.0, 0.7, 1.5]))


@st.composite
def streams(draw):
    """Runs of a target that moves smoothly, and single points from anywhere."""
    events = []
    for _ in range(draw(st.integers(1, 8))):
        if draw(st.booleans()):
            start, velocity = draw(points), draw(st.tuples(*[st.floats(-3.0, 3.0)] * 3))
            frame, age = draw(frames), draw(ages)
            for k in range(draw(st.integers(3, 25))):
                point = tuple(x + 0.033 * k * v for x, v in zip(start, velocity, strict=True))
                events.append((0.033, frame, age, point))
        else:
            events.append((draw(gaps), draw(frames), draw(ages), draw(points)))
    return events


class Rig:
    """A tracker between a buffer of transforms and a servo with delay and coarse encoders."""

    def __init__(self, model, law, life, limits=None, parameters=None):
        self.buffer = TransformBuffer()
        self.buffer.set_model(model)
        self.tracker = Tracker(HEAD, LAWS[law](HEAD, PERIOD / SECOND, limits, parameters))
        self.tracker.machine.parameters = life
        self.placer = TargetPlacer(self.buffer, HEAD.base_frame, 1.0)
        self.now = START
        self.ideal = IdealHead(self.tracker, START / SECOND, late=2, tick=TICK)
        self.commands, self.misread = [], None

    def offer(self, frame, age, point):
        stamp = 0 if age is None else max(1, self.now - round(age * SECOND))
        self.placer.offer(Target(stamp, frame, point), self.now * 1e-9)

    def step(self):
        self.now += PERIOD
        now = self.ideal.now = self.now * 1e-9
        pan, tilt = self.ideal.measure()
        joints = {"head_pan_joint": pan, "head_tilt_joint": tilt}
        if self.misread is not None:  # as nothing that checks would pass it on
            self.tracker.joints_read(now + 1e-3, (pan, self.misread))
            self.tracker.target_seen(self.misread, (2.0, 0.5, 0.1), now, moving=True)
        self.buffer.set_joint_positions(self.now, joints)
        for target, point in self.placer.place(now, joints):
            self.tracker.target_seen(target.stamp * 1e-9 if target.stamp else now, point, now)
        command = self.tracker.step(now).command
        self.commands.append(command)
        self.ideal.obey(command)
        return command


def inside(command, fastest):
    for goal, speed, limits in (
        (command.pan, command.pan_speed, HEAD.pan_limits),
        (command.tilt, command.tilt_speed, HEAD.tilt_limits),
    ):
        assert math.isfinite(goal)
        assert limits.lower - 1e-9 <= goal <= limits.upper + 1e-9
        assert 0.0 < speed <= fastest + 1e-9


@pytest.mark.parametrize("law", sorted(LAWS))
@settings(max_examples=15)
@given(stream=streams(), fastest=st.floats(0.8, 5.0), recenter=st.booleans(), misread=readings)
def test_commands_stay_inside_and_the_head_ends_at_rest(
    kinectbot, law, stream, fastest, recenter, misread
):
    rig = Rig(
        kinectbot,
        law,
        TargetStateParameters(recenter_timeout=1.0 if recenter else 0.0, default_joint_speed=0.8),
        SpeedLimits(max_joint_speed=fastest),
    )
    for gap, frame, age, point in stream:
        rig.offer(frame, age, point)
        for _ in range(round(gap * 50)):
            rig.misread = misread if rig.now // PERIOD % 5 == 0 else None
            rig.step()
    rig.misread = None
    for _ in range(50 * MOST_SETTLING):
        rig.step()
    for command in rig.commands:
        if command is not None:
            inside(command, fastest)
    rested = rig.ideal.positions
    last = [rig.step() for _ in range(25)]
    assert rig.ideal.positions == pytest.approx(rested, abs=1e-9)
    assert len(set(last)) == 1


HERE, BESIDE = (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)
LOST_IN_A_TURN = [
    *[(0.03, "head_pan_link", 0.0, HERE)] * 3,
    *[(0.033, "head_pan_link", None, BESIDE)] * 3,
    *[(gap, "head_pan_link", 0.0, HERE) for gap in (0.7, 1.5)],
    *[(0.033, "base_link", None, HERE)] * 3,
]


@settings(max_examples=15)
@example(stream=LOST_IN_A_TURN, acceleration=7.0)
@given(stream=streams(), acceleration=st.floats(5.0, 100.0))
def test_speeds_grow_no_faster_than_allowed(kinectbot, stream, acceleration):
    rig = Rig(
        kinectbot,
        "predictive",
        TargetStateParameters(),
        parameters=PredictiveLawParameters(max_joint_acceleration=acceleration),
    )
    change = acceleration * PERIOD / SECOND
    before = (0.0, 0.0)
    for gap, frame, age, point in stream:
        rig.offer(frame, age, point)
        for _ in range(round(gap * 50)):
            command = rig.step()
            if command is None:
                continue
            speeds = command.pan_speed, command.tilt_speed
            for speed, last in zip(speeds, before, strict=True):
                # where the joint rests, the speed is what a nudge would be made with
                assert speed <= max(last + change, 0.25) + 1e-9
            before = speeds
