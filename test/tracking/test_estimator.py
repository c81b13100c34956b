import math
import random

import pytest

from head_tracking.gaze import Ray
from head_tracking.tracking import EstimatorParameters, TargetEstimator, Verdict

RATE = 30


def circle(t):
    return 2.0 * math.cos(0.6 * t), 2.0 * math.sin(0.6 * t), 0.3


def seen(point):
    """A point from the origin: azimuth, angle below the horizon, distance."""
    x, y, z = point
    distance = math.hypot(x, y, z)
    return Ray(math.atan2(y, x), -math.asin(z / distance), distance)


def fed(path, seconds=3.0):
    estimator = TargetEstimator(EstimatorParameters())
    estimator.lead_time = 0.1
    for k in range(int(seconds * RATE)):
        estimator.add(k / RATE, seen(path(k / RATE)), k / RATE)
    return estimator


def miss(estimator, path, ahead):
    """The angle by which the target is expected beside where it is."""
    estimate = estimator.estimate
    time = estimate.stamp + ahead
    pan, tilt, _ = estimate.ray_at(time)
    there = seen(path(time))
    return math.hypot((pan - there.pan) * math.cos(tilt), tilt - there.tilt)


@pytest.mark.parametrize("rate", [5, 30, 200])
def test_a_jump_is_believed_at_every_rate(rate):
    estimator = TargetEstimator(EstimatorParameters())
    for k in range(2 * rate):
        t = k / rate
        estimator.add(t, Ray(0.0 if t < 1.0 else 0.5, 0.0, 2.0), t)
        if t > 1.035 + 1 / rate:
            assert estimator.estimate.ray_at(t).pan == pytest.approx(0.5, abs=0.02)


def test_the_order_in_which_points_come_makes_no_difference():
    in_order, late = fed(circle, 1.0), TargetEstimator(EstimatorParameters())
    order = list(range(RATE))
    for k in range(0, RATE - 3, 3):
        order[k + 1], order[k + 2] = order[k + 2], order[k + 1]
    for k in order:
        late.add(k / RATE, seen(circle(k / RATE)), k / RATE + 0.1)
    ahead = (RATE - 1) / RATE + 0.1
    assert late.estimate.ray_at(ahead) == pytest.approx(in_order.estimate.ray_at(ahead))


def test_points_too_old_from_the_future_or_doubled_are_left_out():
    estimator = fed(circle)
    before, now = estimator.estimate, estimator.estimate.stamp
    assert estimator.add(now - 1.1, seen(circle(0.0)), now) is Verdict.TOO_OLD
    assert estimator.add(now + 5.0, seen(circle(0.0)), now) is Verdict.FUTURE
    assert estimator.add(now, seen(circle(0.0)), now) is Verdict.DOUBLED
    assert estimator.estimate is before


def test_a_target_that_is_not_seen_any_more_comes_to_a_stop():
    estimator = fed(lambda t: (2.0, t, 0.0))
    estimate = estimator.estimate
    stopped = estimate.stamp + estimator.lead_time + estimator.parameters.target_timeout
    end = estimate.ray_at(stopped)
    assert estimate.ray_at(estimate.stamp + 60.0) == pytest.approx(end)


def test_the_distance_of_who_walks_up_to_the_camera_and_stops_stays_right():
    rnd, estimator = random.Random(1), TargetEstimator(EstimatorParameters())
    for k in range(50 * RATE):
        t = k / RATE
        x = max(4.0 - 1.2 * t, 0.4) if t < 40.0 else 0.4 + 0.8 * (t - 40.0)
        ray = seen((x, 0.02 + rnd.gauss(0.0, 0.001), 0.1))
        distance = ray.distance * math.exp(rnd.gauss(0.0, 0.05))
        estimator.add(t, ray._replace(distance=distance), t)
        if t % 4.0 < 1.0 or t < 6.0:  # (while a walk begins or ends the distance may lag)
            continue
        assert estimator.estimate.ray_at(t).distance == pytest.approx(ray.distance, rel=0.25)


@pytest.mark.parametrize("distance", [1e-300, 1e12])
def test_no_distance_makes_the_estimate_infinite(distance):
    estimator = fed(circle)
    for k in range(1, 60):
        t = estimator.estimate.stamp + 1 / RATE
        ray = seen(circle(t))
        estimator.add(t, ray._replace(distance=distance if k % 7 else ray.distance), t)
        assert all(map(math.isfinite, estimator.estimate.ray_at(t + 0.3)))


def swing(t, frequency=0.5):
    bearing = 0.5 * math.sin(math.tau * frequency * t)
    return 2.0 * math.cos(bearing), 2.0 * math.sin(bearing), 0.1


def test_a_slow_detector_with_an_outlier_crashes_nothing():
    estimator = TargetEstimator(EstimatorParameters(target_timeout=3.0))
    for k in range(40):
        t = 1.2 * k
        off = 0.05 if k % 10 == 9 else 0.0
        assert estimator.add(t, Ray(0.3 + off, 0.0, 2.0), t).used
        assert estimator.estimate.ray_at(t).pan == pytest.approx(0.3, abs=0.06)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_what_is_not_finite_is_not_used(value):
    estimator = fed(circle)
    before, now = estimator.estimate, estimator.estimate.stamp + 1 / RATE
    for ray in (Ray(value, 0.0, 2.0), Ray(0.0, value, 2.0), Ray(0.0, 0.0, value)):
        assert estimator.add(now, ray, now) is Verdict.NOT_FINITE
    assert estimator.estimate is before


@pytest.mark.parametrize("apart", [0.03, 0.09])
def test_two_points_are_trusted_no_longer_than_they_are_apart(apart):
    estimator = TargetEstimator(EstimatorParameters())
    estimator.add(0.0, Ray(0.0, 0.0, 2.0), 0.0)
    estimator.add(1 / RATE, Ray(apart, 0.0, 2.0), 1 / RATE)
    for ahead in (0.1, 0.3, 0.5, 5.0):
        pan = estimator.estimate.ray_at(1 / RATE + ahead).pan
        assert -0.01 < pan < 2.5 * apart


@pytest.mark.parametrize(("late", "allowed"), [(0.12, 0.05), (0.4, 0.12)])
def test_five_points_a_second_of_a_swing_are_enough(late, allowed):
    rnd, estimator, worst = random.Random(1), TargetEstimator(EstimatorParameters()), 0.0
    lead = late + 0.16
    estimator.lead_time = lead
    for k in range(150):
        t = k / 5
        off = 0.4 if k % 23 == 22 else 0.0
        ray = seen(swing(t))
        noisy = Ray(ray.pan + rnd.gauss(0.0, 0.002) + off, ray.tilt, 2.0)
        verdict = estimator.add(t, noisy, t + late)
        if t > 6.0:
            assert verdict is (Verdict.JUMP if off else Verdict.TAKEN)
            worst = max(worst, 0.0 if off else miss(estimator, swing, lead))
    assert worst < allowed


def test_points_of_a_second_slower_camera_are_used_on_a_fast_swing():
    estimator, seldom = TargetEstimator(EstimatorParameters()), []
    points = [(k / 15 + 0.05, k / 15) for k in range(150)]
    points += [(k / 5 + 0.35, k / 5 + 0.01) for k in range(50)]
    for now, stamp in sorted(points):
        verdict = estimator.add(stamp, seen(swing(stamp, 1.0)), now)
        if now - stamp > 0.2 and now > 3.0:
            seldom.append(verdict)
    assert seldom.count(Verdict.TAKEN) == len(seldom)


def test_late_points_that_agree_can_confirm_a_jump():
    estimator = fed(lambda t: (2.0, 0.0, 0.0))
    start = estimator.estimate.stamp
    estimator.add(start + 0.2, Ray(0.0, 0.0, 2.0), start + 0.2)
    verdicts = [
        estimator.add(start + ago, Ray(0.5, 0.0, 2.0), start + 0.21) for ago in (0.18, 0.1, 0.02)
    ]
    assert verdicts[0] is Verdict.JUMP
    assert Verdict.NEW_TARGET in verdicts


@pytest.mark.parametrize("frequency", [0.0, 0.2, 1.0])
def test_stated_deviations_are_those_of_the_predictions(frequency):
    rnd, estimator = random.Random(7), TargetEstimator(EstimatorParameters())
    estimator.lead_time = ahead = 0.17
    path = lambda t: swing(t, frequency)  # noqa: E731
    squares = []
    for k in range(20 * RATE):
        t = k / RATE
        ray = seen(path(t))
        pan, tilt = ray.pan + rnd.gauss(0.0, 0.002), ray.tilt + rnd.gauss(0.0, 0.002)
        estimator.add(t, Ray(pan, tilt, 2.0), t)
        if t > 2.0:
            there, estimate = seen(path(t + ahead)), estimator.estimate
            expected = estimate.ray_at(t + ahead)
            for joint in (0, 1):
                off = expected[joint] - there[joint]
                squares.append((off / estimate.deviation(joint, t + ahead)) ** 2)
    assert 0.5 < sum(squares) / len(squares) < 2.0
    for bearing in estimator.estimate.bearings:
        assert math.sqrt(bearing.variance) == pytest.approx(0.002, rel=0.5)


@pytest.mark.parametrize(("level", "verdict"), [(0.0, Verdict.TAKEN), (1.3, Verdict.JUMP)])
def test_how_far_a_point_is_away_depends_on_the_elevation_of_the_rays(level, verdict):
    estimator = TargetEstimator(EstimatorParameters(), level)
    for k in range(60):
        estimator.add(k / RATE, Ray(0.0, 1.3, 2.0), k / RATE)
    assert estimator.add(2.0, Ray(0.12, 1.3, 2.0), 2.0) is verdict


def test_of_two_persons_who_take_turns_the_known_one_is_believed_at_once():
    estimator, verdicts = TargetEstimator(EstimatorParameters()), []
    for k in range(6 * RATE):
        t = k / RATE
        verdict = estimator.add(t, Ray(0.5 if k // RATE % 2 else -0.5, 0.0, 2.0), t)
        verdicts.append(verdict)
    assert verdicts[RATE] is Verdict.JUMP  # (nobody was there before)
    assert all(verdicts[k * RATE] is Verdict.NEW_TARGET for k in range(2, 6))


def test_a_suspect_that_comes_twice_confirms_nothing():
    estimator = fed(circle)
    now = estimator.estimate.stamp + 1 / RATE
    assert estimator.add(now, seen((2.0, -2.0, 0.5)), now) is Verdict.JUMP
    assert estimator.add(now, seen((2.0, -2.0, 0.5)), now) is Verdict.DOUBLED
    assert estimator.add(now + 0.01, seen((2.0, 2.0, 0.5)), now) is Verdict.JUMP
    assert estimator.add(now + 0.02, seen((0.5, 2.0, 2.5)), now) is Verdict.JUMP


def test_a_false_detection_that_recurs_throws_the_head_once():
    estimator, thrown = TargetEstimator(EstimatorParameters()), 0
    for k in range(20 * RATE):
        t = k / RATE
        poster = t < 1.0 or (t > 3.0 and k % 20 == 0)
        estimator.add(t, Ray(0.5 if poster else -0.5, 0.0, 2.0), t)
        pan = estimator.estimate.ray_at(t).pan
        thrown += t > 3.0 and pan > -0.4
    assert thrown <= 1


def after_a_gap(*pans, gap=1.0):
    """A target at pan 0, a gap, and points at these pans; verdicts, estimator and time."""
    estimator = TargetEstimator(EstimatorParameters())
    for k in range(RATE):
        estimator.add(k / RATE, Ray(0.0, 0.0, 2.0), k / RATE)
    times = [1.0 + gap + k / RATE for k in range(len(pans))]
    verdicts = [estimator.add(t, Ray(pan, 0.0, 2.0), t) for t, pan in zip(times, pans, strict=True)]
    return verdicts, estimator, times[-1]


@pytest.mark.parametrize(
    ("gap", "first", "second"),
    [(0.6, 0.3, 0.0), (20.0, 0.3, 0.0), (1.0, 0.5, 0.5)],
)
def test_after_a_gap_the_second_point_is_the_target(gap, first, second):
    """The first one may be a false detection."""
    verdicts, estimator, now = after_a_gap(first, second, gap=gap)
    assert verdicts == [Verdict.JUMP, Verdict.NEW_TARGET]
    assert not estimator.settle(now + 1.0)
    assert estimator.estimate.ray_at(now).pan == pytest.approx(second, abs=1e-3)


def test_a_lone_point_after_a_gap_is_believed_if_nothing_contradicts_it():
    _, estimator, now = after_a_gap(0.5)
    assert not estimator.settle(now + 0.1)
    assert estimator.settle(now + 0.25)
    assert estimator.estimate.ray_at(now).pan == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("rate", [15, 30])
def test_a_fast_start_is_followed_without_a_stop(rate):
    rnd, estimator = random.Random(1), TargetEstimator(EstimatorParameters())
    path = lambda t: -1.0 + (1.0 - math.cos(3.5 * min(max(t - 2.0, 0.0), 0.9)))  # noqa: E731
    for k in range(4 * rate):
        t = k / rate
        estimator.add(t, Ray(path(t) + rnd.gauss(0.0, 0.005), 0.0, 2.0), t)
        assert abs(estimator.estimate.ray_at(t).pan - path(t)) < 0.45


@pytest.mark.parametrize("seed", range(2))
def test_a_target_that_stops_is_not_predicted_on(seed):
    """The mean error 0.1 s ahead, in the 0.6 s after a stop from 1 rad/s."""
    rnd, estimator = random.Random(seed), TargetEstimator(EstimatorParameters())
    missed = []
    for k in range(156):
        t = k / 60.0
        estimator.add(t, Ray(min(t, 2.0) + rnd.gauss(0.0, 0.003), 0.0, 2.0), t)
        if t >= 2.0:
            missed.append(abs(estimator.estimate.ray_at(t + 0.1).pan - 2.0))
    assert sum(missed) / len(missed) < 0.0163


@pytest.mark.parametrize(
    "false",
    [
        [(0.0, 0.17, -0.24), (0.2, 0.1, 0.0)],
        [(0.0, 0.17, -0.24), (0.4, 0.1, 0.24)],
        [(0.0, -0.08, -0.13), (0.14, 0.12, -0.17), (0.4, -0.22, -0.21)],  # to and fro
        [(0.0, -0.14, 0.19), (0.04, -0.22, 0.2)],  # near each other, but fast
    ],
)
def test_false_detections_beside_a_target_at_rest_are_no_motion(false):
    """Each at a time [s] since the first; pan and tilt from the target [rad]."""
    estimator = TargetEstimator(EstimatorParameters())
    for k in range(30):
        estimator.add(k / 15.0, Ray(0.7, -0.06, 2.0), k / 15.0 + 0.1)
    for t, pan, tilt in false:
        verdict = estimator.add(2.0 + t, Ray(0.7 + pan, tilt - 0.06, 2.0), t + 2.1)
        assert verdict is Verdict.JUMP
    pan, tilt, _ = estimator.estimate.ray_at(2.5 + false[-1][0])
    assert abs(pan - 0.7) < 0.02
    assert abs(tilt + 0.06) < 0.02


def test_a_false_detection_after_the_first_point_behind_a_gap_is_no_motion():
    """That point was far from the prediction, and is used: there was time for the way."""
    estimator = TargetEstimator(EstimatorParameters())
    for k in range(30):
        estimator.add(k / 15.0, Ray(0.7, 0.0, 2.0), k / 15.0 + 0.1)
    assert estimator.add(35 / 15.0, Ray(0.84, 0.0, 2.0), 2.43) is Verdict.TAKEN
    pan = estimator.estimate.ray_at(2.4).pan
    assert estimator.add(2.4, Ray(pan, 0.17, 2.0), 2.5) is Verdict.JUMP
    assert abs(estimator.estimate.ray_at(2.8).tilt) < 0.02


def test_a_slow_detector_sees_few_outliers_in_a_person_who_starts_and_stops():
    """Five points a second, 400 ms late; moves of minimum jerk between random places."""
    used = []
    for seed in range(4):
        rnd, estimator = random.Random(seed), TargetEstimator(EstimatorParameters())
        estimator.lead_time = 0.5
        start, goal, began, took = 0.0, 0.0, 0.0, 1.0
        for k in range(300):
            t = k / 5
            if t > began + took + 1.0:
                start, goal, began, took = goal, rnd.uniform(-0.6, 0.6), t, rnd.uniform(0.8, 1.6)
            s = min((t - began) / took, 1.0)
            pan = start + (goal - start) * s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
            ray = Ray(pan + rnd.gauss(0.0, 0.005), rnd.gauss(0.0, 0.005), 2.0)
            used.append(estimator.add(t, ray, t + 0.4).used)
    assert sum(used) > 0.955 * len(used)


@pytest.mark.parametrize(
    ("rate", "late", "motion", "verdicts"),
    [
        # after 0.7 s unseen: the speed that was good at rest says nothing any more
        (15, 0.1, ((0.7, 0.03), (0.7 + 1 / 15, 0.09)), [Verdict.NEW_TARGET, Verdict.TAKEN]),
        # a slow detector: the second point of the motion is far from the first
        (5, 0.6, ((0.2, 0.01), (0.4, 0.09)), [Verdict.TAKEN, Verdict.TAKEN]),
    ],
)
def test_who_walks_on_after_a_rest_is_believed_at_the_second_point(rate, late, motion, verdicts):
    estimator, rnd = TargetEstimator(EstimatorParameters()), random.Random(3)
    for k in range(4 * rate):
        estimator.add(k / rate, Ray(rnd.gauss(0.0, 0.003), 0.0, 2.0), k / rate + late)
    rest = (4 * rate - 1) / rate
    found = [estimator.add(rest + t, Ray(pan, 0.0, 2.0), rest + t + late) for t, pan in motion]
    assert found == verdicts
