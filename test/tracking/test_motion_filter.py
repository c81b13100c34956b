"""The bank of filters against the textbook: one filter at a time, by matrices."""

import numpy as np
import pytest
from head_tracking.tracking.motion_filter import (
    RESTLESS,
    STEADY,
    SWINGING,
    THE_RESTLESS,
    Bank,
)


def expm(matrix):
    term = result = np.eye(len(matrix))
    for n in range(1, 40):
        term = term @ matrix / n
        result = result + term
    return result


def disturbance(generator, density, dt):
    """Van Loan's integral of the noise that drives the last non-zero state."""
    n = len(generator)
    big = np.zeros((2 * n, 2 * n))
    big[:n, :n], big[:n, n:], big[n:, n:] = -generator, density, generator.T
    whole = expm(big * dt)
    return whole[n:, n:].T @ whole[:n, n:]


def textbook(kind, rate, agility, points, times):
    generator = np.zeros((3, 3))
    generator[0, 1] = 1.0
    density = np.zeros((3, 3))
    if kind == "restless":
        density[1, 1] = agility
    else:
        generator[1, 2] = 1.0
        density[2, 2] = agility
    swinging = generator.copy()
    if kind == "swinging":
        swinging[2, 1] = -rate * rate
    state, covariance = np.array([points[0], 0.0, 0.0]), np.diag([1.0, 1e6, 1e6])
    for dt, z in zip(np.diff(times), points[1:], strict=True):
        f = expm(swinging * dt)
        if kind == "restless":
            f[2, 2] = 0.0  # it has no acceleration
        covariance = f @ covariance @ f.T + disturbance(generator, density, dt)
        state = f @ state
        gain = covariance[:, 0] / (covariance[0, 0] + 1.0)
        state = state + gain * (z - state[0])
        covariance = covariance - np.outer(gain, covariance[0])
    return state, covariance


KINDS = [
    *(("steady", agility, index) for index, agility in enumerate(STEADY)),
    ("restless", RESTLESS, THE_RESTLESS),
    *(("swinging", agility, THE_RESTLESS + 1 + i) for i, agility in enumerate(SWINGING)),
]


@pytest.mark.parametrize(("kind", "agility", "index"), KINDS)
def test_every_filter_is_the_textbooks(kind, agility, index):
    rng = np.random.default_rng(index)
    times = np.cumsum(rng.uniform(0.01, 0.1, 30))
    points = rng.normal(size=(30, 2))
    rates = np.array([3.0, 7.0])
    bank = Bank.seen_once(points[0])
    for dt, point in zip(np.diff(times), points[1:], strict=True):
        bank, _ = bank.corrected(dt, rates, point)
    for c in range(2):
        state, covariance = textbook(kind, rates[c], agility, points[:, c], times)
        assert bank.states[c, index] == pytest.approx(state, rel=1e-6, abs=1e-6)
        assert bank.covariances[c, index] == pytest.approx(covariance, rel=1e-5, abs=1e-6)


def test_predictions_go_on_as_the_states_say():
    rates = np.array([2.0])
    bank = Bank.seen_once(np.array([0.5]))
    bank.states[0, :] = (0.5, 1.0, -2.0)
    after = bank.positions_after(0.3, rates)[0]
    steady = 0.5 + 0.3 - 0.09
    swing = 0.5 + np.sin(0.6) / 2.0 - 2.0 * (1.0 - np.cos(0.6)) / 4.0
    assert after == pytest.approx([steady] * (THE_RESTLESS + 1) + [swing] * len(SWINGING))


def test_a_swing_of_rate_zero_is_a_steady_motion():
    bank = Bank.seen_once(np.array([1.0]))
    bank.states[0, :] = (1.0, 2.0, 3.0)
    after = bank.positions_after(0.1, np.zeros(1))
    assert after[0] == pytest.approx([1.215] * after.shape[1], abs=1e-6)
