import math
import random

import pytest

from head_tracking.gaze import Sight
from head_tracking.tracking import EstimatorParameters, TargetEstimator, Verdict

RATE = 30


def circle(t, speed=0.6, radius=2.0):
    return radius * math.cos(speed * t), radius * math.sin(speed * t), 0.3


def seen(point):
    """A point from the origin: azimuth, angle below the horizon, distance."""
    x, y, z = point
    distance = math.hypot(x, y, z)
    return Sight(math.atan2(y, x), -math.asin(z / distance), distance)


def place(sight):
    flat = sight.distance * math.cos(sight.tilt)
    return (
        flat * math.cos(sight.pan),
        flat * math.sin(sight.pan),
        -sight.distance * math.sin(sight.tilt),
    )


def noisy(point, rnd, noise):
    return tuple(x + rnd.gauss(0.0, noise) for x in point)


def fed(path, seconds=3.0, noise=0.0, parameters=None, horizon=0.1):
    rnd = random.Random(1)
    estimator = TargetEstimator(parameters or EstimatorParameters())
    estimator.horizon = horizon
    for k in range(int(seconds * RATE)):
        t = k / RATE
        estimator.add(t, seen(noisy(path(t), rnd, noise)), t)
    return estimator


def miss(estimator, path, ahead):
    """The angle by which the target is expected beside where it is."""
    estimate = estimator.estimate
    time = estimate.stamp + ahead
    pan, tilt = estimate.bearing(time)
    there = seen(path(time))
    return math.hypot((pan - there.pan) * math.cos(tilt), tilt - there.tilt)


def test_before_the_first_point_nothing_is_known():
    assert TargetEstimator(EstimatorParameters()).estimate is None


def test_one_point_is_a_target_that_stands_still():
    estimator = TargetEstimator(EstimatorParameters())
    assert estimator.add(1.0, seen((1.0, 2.0, 3.0)), 1.0) is Verdict.NEW_TARGET
    assert place(estimator.estimate.sight_at(1.2)) == pytest.approx((1.0, 2.0, 3.0))
    assert estimator.estimate.velocity(1.2) == pytest.approx((0.0, 0.0))


def test_a_straight_motion_is_predicted():
    path = lambda t: (2.0, -1.0 + 0.8 * t, 0.1 * t)  # noqa: E731
    estimator = fed(path)
    assert miss(estimator, path, 0.2) < 1e-3


def test_a_swing_is_predicted_where_a_straight_line_is_far_off():
    path = lambda t: (2.0, 0.5 * math.sin(2 * math.pi * t), 0.0)  # noqa: E731
    estimator = fed(path, 6.0, noise=0.004, horizon=0.17)
    assert miss(estimator, path, 0.17) < 0.01
    estimate = estimator.estimate
    pan, tilt = estimate.bearing(estimate.stamp)
    speed, _ = estimate.velocity(estimate.stamp)
    straight = place(Sight(pan + 0.17 * speed, tilt, 2.0))
    assert math.dist(straight, path(estimate.stamp + 0.17)) > 0.03


def test_noise_is_averaged_out_for_a_calm_target():
    still = lambda t: (2.0, 0.0, 0.3)  # noqa: E731
    errors = [
        miss(fed(still, seconds, noise=0.004), still, 0.1) for seconds in (2.0, 2.5, 3.0, 3.5, 4.0)
    ]
    assert sum(errors) / len(errors) < 0.002


def test_it_knows_how_noisy_the_points_are_and_how_sure_it_is():
    calm = fed(lambda t: (2.0, 0.0, 0.3), noise=0.001).estimate
    rough = fed(lambda t: (2.0, 0.0, 0.3), noise=0.02).estimate
    assert 3.0 < rough.noise[0] / calm.noise[0] < 100.0
    assert rough.deviation(0, rough.stamp) > calm.deviation(0, calm.stamp)
    assert rough.deviation(0, rough.stamp + 0.3) > rough.deviation(0, rough.stamp)
    assert rough.speed_deviation(0) > calm.speed_deviation(0)
    assert rough.age(rough.stamp + 0.3) == pytest.approx(0.3)


def test_one_outlier_changes_nothing():
    estimator = fed(circle)
    stamp = estimator.estimate.stamp + 1 / RATE
    before = estimator.estimate
    assert estimator.add(stamp, seen((5.0, -3.0, 1.0)), stamp) is Verdict.JUMP
    assert estimator.estimate is before


def test_a_target_that_jumped_to_the_wall_and_back_was_never_there():
    estimator = fed(circle)
    start = estimator.estimate.stamp
    for k in range(1, 60):
        t = start + k / RATE
        point = (4.0, -3.0, 1.0) if k % 10 == 0 else circle(t)
        estimator.add(t, seen(point), t)
        assert miss(estimator, circle, 0.05) < 0.02


def test_a_target_that_stays_elsewhere_is_believed():
    estimator = fed(circle)
    start = estimator.estimate.stamp
    verdicts = [
        estimator.add(start + k / RATE, seen((2.0, -2.0, 0.5)), start + k / RATE)
        for k in range(1, 5)
    ]
    assert verdicts[0] is Verdict.JUMP
    assert Verdict.NEW_TARGET in verdicts
    assert place(estimator.estimate.sight_at(start + 0.2)) == pytest.approx(
        (2.0, -2.0, 0.5), abs=0.01
    )


def test_outliers_here_and_there_are_not_a_new_target():
    estimator = fed(circle)
    start, rnd = estimator.estimate.stamp, random.Random(3)
    for k in range(1, 10):
        wild = (rnd.uniform(-4, 4), rnd.uniform(-4, 4), rnd.uniform(2, 4))
        assert estimator.add(start + k / RATE, seen(wild), start + k / RATE) is Verdict.JUMP


def test_the_order_in_which_points_come_makes_no_difference():
    in_order, late = fed(circle, 1.0), TargetEstimator(EstimatorParameters())
    order = list(range(RATE))
    for k in range(0, RATE - 3, 3):
        order[k + 1], order[k + 2] = order[k + 2], order[k + 1]
    for k in order:
        late.add(k / RATE, seen(circle(k / RATE)), k / RATE + 0.1)
    ahead = (RATE - 1) / RATE + 0.1
    assert late.estimate.sight_at(ahead) == pytest.approx(in_order.estimate.sight_at(ahead))


def test_points_too_old_from_the_future_or_doubled_are_left_out():
    estimator = fed(circle)
    before, now = estimator.estimate, estimator.estimate.stamp
    assert estimator.add(now - 0.6, seen(circle(0.0)), now) is Verdict.TOO_OLD
    assert estimator.add(now + 5.0, seen(circle(0.0)), now) is Verdict.FUTURE
    assert estimator.add(now, seen(circle(0.0)), now) is Verdict.DOUBLED
    assert estimator.estimate is before


def test_clocks_that_differ_a_little_do_no_harm():
    estimator = TargetEstimator(EstimatorParameters())
    for k in range(60):
        t = k / RATE
        estimator.add(t, seen(circle(t)), t - 0.05)
    assert miss(estimator, circle, 0.1) < 0.02


def test_after_a_long_pause_the_target_is_a_new_one():
    estimator = fed(circle)
    later = estimator.estimate.stamp + 3.0
    assert estimator.add(later, seen((2.0, 0.0, 0.0)), later) is Verdict.NEW_TARGET


def test_a_target_that_is_not_seen_any_more_comes_to_a_stop():
    estimator = fed(lambda t: (2.0, t, 0.0))
    estimate = estimator.estimate
    timeout = estimator.parameters.target_timeout
    assert math.hypot(*estimate.velocity(estimate.stamp + timeout)) == pytest.approx(0.0, abs=1e-9)
    end = estimate.sight_at(estimate.stamp + timeout)
    assert estimate.sight_at(estimate.stamp + 60.0) == pytest.approx(end)


def test_velocity_is_the_derivative_of_position():
    estimate = fed(lambda t: (2.0, math.sin(3.0 * t), 0.2 * t), noise=0.002).estimate
    for ahead in (-0.1, 0.0, 0.1, 0.24, 0.3, 0.45, 0.6):
        t, h = estimate.stamp + ahead, 1e-5
        before, after = estimate.bearing(t - h), estimate.bearing(t + h)
        slope = [(b - a) / (2 * h) for a, b in zip(before, after, strict=True)]
        assert estimate.velocity(t) == pytest.approx(slope, abs=1e-4)


def test_it_can_be_forgotten():
    estimator = fed(circle)
    estimator.reset()
    assert estimator.estimate is None


@pytest.mark.parametrize("speed", [0.8, 1.2, 1.6])
@pytest.mark.parametrize("range_noise", [0.0, 0.05])
def test_the_distance_of_who_walks_up_to_the_camera_and_stops_stays_right(speed, range_noise):
    rnd, estimator = random.Random(1), TargetEstimator(EstimatorParameters())
    for k in range(50 * RATE):
        t = k / RATE
        x = max(4.0 - speed * t, 0.4) if t < 40.0 else 0.4 + 0.8 * (t - 40.0)
        sight = seen((x, 0.02 + rnd.gauss(0.0, 0.001), 0.1))
        distance = sight.distance * math.exp(rnd.gauss(0.0, range_noise))
        estimator.add(t, sight._replace(distance=distance), t)
        if t % 4.0 < 1.0 or t < 6.0:  # (while a walk begins or ends the distance may lag)
            continue
        assert estimator.estimate.sight_at(t).distance == pytest.approx(sight.distance, rel=0.25)


@pytest.mark.parametrize("distance", [0.0, 1e-300, 1e12])
def test_no_distance_makes_the_estimate_infinite(distance):
    estimator = fed(circle)
    for k in range(1, 60):
        t = estimator.estimate.stamp + 1 / RATE
        sight = seen(circle(t))
        estimator.add(t, sight._replace(distance=distance if k % 7 else sight.distance), t)
        assert all(map(math.isfinite, estimator.estimate.sight_at(t + 0.3)))
