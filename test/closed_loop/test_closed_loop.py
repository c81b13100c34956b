"""The laws on simulated servos, down to the bytes; the benchmark judges by the same trials."""

import pytest
from closed_loop import Conditions, ax12
from plant import Deaf
from runs import Watched, around, run, sine, tracker

from head_tracking.tracking import LAWS, PredictiveLawParameters, TargetState


@pytest.mark.parametrize(
    ("frequency", "changes", "most"),
    [
        (0.2, {}, 0.006),
        (1.0, {}, 0.045),
        (0.5, {"delay": 0.1}, 0.03),
        (0.3, {"rate": 10.0}, 0.05),
        (0.3, {"rate": 25.0}, 0.02),
        (0.3, {"rate": 100.0}, 0.02),
    ],
)
def test_an_oscillating_target_is_followed_at_any_rate(head, frequency, changes, most):
    steered = tracker(head, rate=changes.get("rate", 50.0))
    outcome = run(head, sine(frequency), Conditions(duration=5.0, noise=0.002, **changes), steered)
    assert outcome.recording.between(2.5).rms < most


def test_a_step_is_made_quickly_and_without_overshoot(head):
    recording = run(
        head, lambda t: around(0.5 if t >= 1.0 else 0.0), Conditions(duration=2.0, field=(3.0, 3.0))
    ).recording
    assert recording.between(1.6).maximum < 0.02  # the first motion of an unknown servo
    assert recording.positions[:, 0].max() < 0.51


def test_a_target_that_stops_is_met_and_left_alone(head):
    outcome = run(head, lambda t: around(min(t, 1.5) - 0.5), Conditions(duration=6.0))
    assert outcome.recording.between(2.5).maximum < 0.012
    assert len(set(outcome.goals[-50:])) == 1


def test_commands_stay_a_short_way_ahead(head):
    """If the node dies, the head moves on for a moment only."""
    outcome = run(head, sine(1.0), Conditions(duration=3.0))
    positions = outcome.recording
    for time, command in outcome.commands[20:]:
        pan = float(positions.between(time - 0.003, time + 0.003).positions[0, 0])
        assert abs(command.pan - pan) < 0.75


def hardest(recording, step=0.02):
    """The hardest acceleration of pan [rad/s^2], from positions a bus cycle apart."""
    pan = recording.positions[:, 0][:: round(step * 250)]
    return max(abs(a - 2 * b + c) for a, b, c in zip(pan, pan[1:], pan[2:], strict=False)) / step**2


def test_another_target_is_no_jerk(head):
    bearings = (0.0, 0.6, -0.5, 0.1)
    parameters = PredictiveLawParameters(max_joint_acceleration=20.0)
    outcome = run(
        head,
        lambda t: around(bearings[min(int(t), 3)]),
        Conditions(duration=4.0),
        tracker(head, parameters=parameters),
    )
    recording = outcome.recording
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


def states(head, path, servo, law, since=0.0):
    """Return the states of the head from a time [s] on."""
    found = set()

    def note(now, steered):
        if now > 1_000.0 + since:
            found.add(steered.state)

    conditions = Conditions(duration=6.0, noise=0.003, servos=ax12(servo))
    run(head, path, conditions, Watched(tracker(head, law), note))
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
def test_servos_that_do_follow_are_not_taken_for_stalled(head, path, servo, law):
    assert TargetState.STALLED not in states(head, path, servo, law)


@pytest.mark.parametrize("law", sorted(LAWS))
def test_servos_that_are_held_are_stalled_within_two_seconds(head, law):
    assert states(head, lambda t: around(0.6), held, law, 2.0) == {TargetState.STALLED}


@pytest.mark.parametrize("until", [0.8, 1.45])
def test_servos_that_are_let_go_turn_to_the_target_and_not_beyond(head, until):
    conditions = Conditions(duration=4.0, servos=lambda start: Deaf(ax12()(start), until))
    recording = run(head, lambda t: around(0.2 + 0.2 * t), conditions).recording
    beyond = recording.positions[:, 0] - recording.wanted[:, 0]
    assert beyond.max() < 0.02
    assert recording.between(until + 1.0).rms < 0.02
