"""The laws on simulated servos, down to the bytes; the benchmark judges by the same trials."""

import math
from dataclasses import replace
from itertools import pairwise

import pytest
from closed_loop import Conditions, ax12
from plant import Deaf, PlainServo, Streamed
from runs import BESIDE, ON_HEAD, Watched, around, circle, run, sine, stop_and_go, swing, tracker

from head_tracking.gaze import HeadCommand
from head_tracking.tracking import (
    LAWS,
    JointReading,
    PredictiveLawParameters,
    SetpointStream,
    TargetState,
)


def drift(speed):
    """To and fro; the law `position` has 1.9 to 7.6 mrad."""
    return lambda t: around(speed * abs((t + 2.0) % 16.0 - 8.0))


def walked_up(t):
    """Walk up to the head, and move on after a pause."""
    bearing, distance = 0.3 * math.sin(max(t - 32.0, 0.0)), max(3.0 - 1.2 * t, 0.5)
    return distance * math.cos(bearing), distance * math.sin(bearing), 0.16


USUAL = Conditions(duration=5.0, noise=0.002)
DRIFT = replace(BESIDE, duration=20.0, on_head=True)
WEAK = PlainServo(acceleration=5.0)


def behind(seconds):
    """A trajectory controller that is late, instead of our servo bus."""
    servos = Streamed(seconds, stream=lambda: SetpointStream(0.02, 0.0))
    return replace(USUAL, duration=30.0, servos=servos)


@pytest.mark.parametrize(
    ("path", "conditions", "start", "most"),
    [
        (sine(0.2), USUAL, 2.5, 0.006),
        (sine(1.0), USUAL, 2.5, 0.045),
        (sine(0.5), replace(USUAL, delay=0.1), 2.5, 0.03),
        *((sine(0.3), replace(USUAL, rate=each), 2.5, 0.02) for each in (25.0, 100.0)),
        (sine(0.3), replace(USUAL, rate=10.0), 2.5, 0.05),
        (sine(0.5), behind(0.05), 3.0, 0.02),
        (sine(0.5), behind(0.2), 3.0, 0.06),
        # too fast for the servo: a swing of 0.5 rad needs accelerations of up to 4.9 rad/s^2
        (sine(0.5), replace(BESIDE, servos=PlainServo(acceleration=4.0)), 10.0, 0.28),
        # a weak servo that leaves its commands is caught where it is
        (stop_and_go, replace(BESIDE, duration=12.0, delay=0.08, servos=WEAK, seed=2), 0.0, 0.06),
        (drift(0.006), replace(DRIFT, start=(0.036, 0.0), servos=PlainServo()), 4.0, 0.0044),
        (drift(0.015), replace(DRIFT, start=(0.09, 0.0)), 4.0, 0.00575),
        (sine(0.5), replace(ON_HEAD, servos=PlainServo(dead_time=0.15)), 3.0, 0.04),
        (swing, replace(ON_HEAD, servos=WEAK, duration=20.0, field=(3.0, 3.0)), 14.0, 0.03),
        (circle, replace(ON_HEAD, range_noise=0.2), 3.0, 0.01),
        (circle, replace(ON_HEAD, outliers=0.05, outlier=0.1, seed=2), 3.0, 0.022),
        (
            *(sine(0.5), replace(ON_HEAD, outliers=0.09, outlier=1.5, lost=0.15, seed=2)),
            *(3.0, 0.03),
        ),
        (walked_up, replace(ON_HEAD, servos=PlainServo(), duration=38.0), 33.0, 0.03),
    ],
    ids=[
        *("0.2 Hz", "1 Hz", "late points", "25 a second", "100 a second", "10 a second"),
        *("late controller", "very late controller", "too fast", "weak", "drifts slowly", "drifts"),
        *("late servos", "heavy head", "distances", "outliers", "fast swing", "walked up"),
    ],
)
def test_a_target_is_followed_for_good(path, conditions, start, most):
    recording = run(path, conditions).recording
    assert recording.between(start).rms < most
    assert recording.between(max(start, 0.67 * conditions.duration)).rms < most


def test_a_step_is_made_quickly_and_without_overshoot():
    conditions = Conditions(duration=2.0, field=(3.0, 3.0))
    recording = run(lambda t: around(0.5 if t >= 1.0 else 0.0), conditions).recording
    assert recording.between(1.6).maximum < 0.02  # the first motion of an unknown servo
    assert recording.positions[:, 0].max() < 0.51


def test_a_target_that_stops_is_met_and_left_alone():
    outcome = run(lambda t: around(min(t, 1.5) - 0.5), Conditions(duration=6.0))
    assert outcome.recording.between(2.5).maximum < 0.012
    assert len(set(outcome.goals[-50:])) == 1


def test_commands_stay_a_short_way_ahead():
    """If the node dies, the head moves on for a moment only."""
    outcome = run(sine(1.0), Conditions(duration=3.0))
    positions = outcome.recording
    for time, command in outcome.commands[20:]:
        pan = float(positions.between(time - 0.003, time + 0.003).positions[0, 0])
        assert abs(command.pan - pan) < 0.75


def hardest(recording, step=0.02):
    """The hardest acceleration of pan [rad/s^2], from positions a bus cycle apart."""
    pan = recording.positions[:, 0][:: round(step * 250)]
    return max(abs(a - 2 * b + c) for a, b, c in zip(pan, pan[1:], pan[2:], strict=False)) / step**2


def test_another_target_is_no_jerk():
    bearings = (0.0, 0.6, -0.5, 0.1)
    parameters = PredictiveLawParameters(max_joint_acceleration=20.0)
    path = lambda t: around(bearings[min(int(t), 3)])  # noqa: E731
    recording = run(path, Conditions(duration=4.0), tracker(parameters=parameters)).recording
    assert recording.between(3.8).maximum < 0.02
    assert hardest(recording) < 30.0


def heavy(servo):
    servo.drive.mechanics.inertia *= 6.0


def slow(servo):
    servo.supply_voltage = 6.0
    servo.set_register("Min Voltage Limit", 50)


def soft(servo):
    for side in ("CW", "CCW"):
        servo.set_register(f"{side} Compliance Slope", 64)


def held(servo):
    servo.drive.mechanics.inertia *= 1e6


def states(path, servo, law, since=0.0):
    """Return the states of the head from a time [s] on."""
    found = set()

    def note(now, steered):
        if now > 1_000.0 + since:
            found.add(steered.state)

    conditions = Conditions(duration=6.0, noise=0.003, servos=ax12(servo))
    run(path, conditions, Watched(tracker(law), note))
    return found


def to_and_fro(t):
    return around(0.8 if t % 2.0 < 1.0 else -0.8)


@pytest.mark.parametrize(
    ("path", "servo", "law"),
    [
        (sine(1.0), slow, "position"),
        (sine(4.0), heavy, "speed"),
        (to_and_fro, heavy, "predictive"),
        (to_and_fro, soft, "speed"),
        (lambda t: around(4.0), slow, "predictive"),
    ],
)
def test_servos_that_do_follow_are_not_taken_for_stalled(path, servo, law):
    assert TargetState.STALLED not in states(path, servo, law)


@pytest.mark.parametrize("law", sorted(LAWS))
def test_servos_that_are_held_are_stalled_within_two_seconds(law):
    assert states(lambda t: around(0.6), held, law, 2.0) == {TargetState.STALLED}


@pytest.mark.parametrize("until", [0.8, 1.45])
def test_servos_that_are_let_go_turn_to_the_target_and_not_beyond(until):
    conditions = Conditions(duration=4.0, servos=lambda start: Deaf(ax12()(start), until))
    recording = run(lambda t: around(0.2 + 0.2 * t), conditions).recording
    beyond = recording.positions[:, 0] - recording.wanted[:, 0]
    assert beyond.max() < 0.02
    assert recording.between(until + 1.0).rms < 0.02


# The positions that a trajectory controller is sent


def stream(commands, *, obeys=True):
    """Return the positions sent for commands that come once a second."""
    stream, measured, sent = SetpointStream(0.02, 0.0), (0.0, 0.0), []
    for step in range(50 * len(commands)):
        command, now = commands[step // 50] if step % 50 == 0 else None, 0.02 * step
        positions = stream.positions(command, JointReading(now, measured), now)
        if positions is not None:
            sent.append(positions)
            measured = positions if obeys else measured
    return sent


def test_the_stream_approaches_a_goal_at_its_speed_and_ends():
    sent = stream([HeadCommand(0.3, -0.1, 1.0, 0.25)])
    assert sent[-1] == pytest.approx((0.3, -0.1))
    pans = [pan for pan, _ in sent]
    assert pans[0] == pytest.approx(0.05)
    assert max(b - a for a, b in pairwise(pans)) == pytest.approx(0.02)
    assert 13 <= len(sent) <= 22


def test_the_setpoint_of_a_joint_that_does_not_follow_returns_to_the_joint():
    sent = stream([HeadCommand(2.0, 0.0, 1.0, 1.0)] * 2, obeys=False)
    assert max(pan for pan, _ in sent) < 0.8
    assert sent[-1][0] < 0.1


def test_after_a_pause_the_stream_starts_at_the_measured_position():
    stream, measured = SetpointStream(0.02, 0.0), JointReading(5.0, (0.7, 0.0))
    stream.positions(HeadCommand(0.1, 0.0, 9.0, 9.0), JointReading(0.0, (0.0, 0.0)), 0.0)
    assert stream.positions(HeadCommand(1.0, 0.0, 1.0, 1.0), measured, 5.0) == (0.75, 0.0)
    stream.stop()
    assert stream.positions(None, measured, 5.1) is None
