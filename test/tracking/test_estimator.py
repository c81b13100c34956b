import math
import random

import pytest

from head_tracking.gaze import Ray
from head_tracking.tracking import EstimatorParameters, TargetEstimator, Verdict

RATE = 30


def at(pan, tilt=0.0):
    return Ray(pan, tilt, 2.0)


def seen(point):
    """A point from the origin: azimuth, angle below the horizon, distance."""
    x, y, z = point
    distance = math.hypot(x, y, z)
    return Ray(math.atan2(y, x), -math.asin(z / distance), distance)


def circle(t):
    return seen((2.0 * math.cos(0.6 * t), 2.0 * math.sin(0.6 * t), 0.3))


def swing(t, frequency=0.5):
    bearing = 0.5 * math.sin(math.tau * frequency * t)
    return seen((2.0 * math.cos(bearing), 2.0 * math.sin(bearing), 0.1))


def steps(path, seconds, rate=RATE, late=0.0, lead=None, **parameters):
    """Feed the rays of a path; yield time, verdict and estimator after each."""
    estimator = TargetEstimator(EstimatorParameters(**parameters))
    if lead is not None:
        estimator.lead_time = lead
    for k in range(round(seconds * rate)):
        t = k / rate
        yield t, estimator.add(t, path(t), t + late), estimator


def fed(path, seconds=3.0, rate=RATE, late=0.0, lead=0.1):
    *_, (_, _, estimator) = steps(path, seconds, rate, late, lead)
    return estimator


@pytest.mark.parametrize("rate", [5, 30, 200])
def test_a_jump_is_believed_at_every_rate(rate):
    for t, _, estimator in steps(lambda t: at(0.0 if t < 1.0 else 0.5), 2.0, rate):
        if t > 1.035 + 1 / rate:
            assert estimator.estimate.ray_at(t).pan == pytest.approx(0.5, abs=0.02)


def test_the_order_in_which_points_come_makes_no_difference():
    in_order, late = fed(circle, 1.0), TargetEstimator(EstimatorParameters())
    order = list(range(RATE))
    for k in range(0, RATE - 3, 3):
        order[k + 1], order[k + 2] = order[k + 2], order[k + 1]
    for k in order:
        late.add(k / RATE, circle(k / RATE), k / RATE + 0.1)
    ahead = (RATE - 1) / RATE + 0.1
    assert late.estimate.ray_at(ahead) == pytest.approx(in_order.estimate.ray_at(ahead))


@pytest.mark.parametrize(
    ("later", "late", "ray", "verdict"),
    [
        (-1.1, 1.1, circle(0.0), Verdict.TOO_OLD),
        (5.0, -5.0, circle(0.0), Verdict.FUTURE),
        (0.0, 0.0, circle(0.0), Verdict.DOUBLED),
        *(
            (1 / RATE, 0.0, ray, Verdict.NOT_FINITE)
            for bad in (math.nan, math.inf)
            for ray in (Ray(bad, 0.0, 2.0), Ray(0.0, bad, 2.0), Ray(0.0, 0.0, bad))
        ),
    ],
)
def test_points_that_cannot_be_used_are_left_out(later, late, ray, verdict):
    estimator = fed(circle)
    before, stamp = estimator.estimate, estimator.estimate.stamp + later
    assert estimator.add(stamp, ray, stamp + late) is verdict
    assert estimator.estimate is before


def test_a_target_that_is_not_seen_any_more_comes_to_a_stop():
    estimator = fed(lambda t: seen((2.0, t, 0.0)))
    estimate = estimator.estimate
    stopped = estimate.stamp + estimator.lead_time + estimator.parameters.target_timeout
    end = estimate.ray_at(stopped)
    assert estimate.ray_at(estimate.stamp + 60.0) == pytest.approx(end)


def test_the_distance_of_who_walks_up_to_the_camera_and_stops_stays_right():
    rnd = random.Random(1)

    def place(t):
        x = max(4.0 - 1.2 * t, 0.4) if t < 40.0 else 0.4 + 0.8 * (t - 40.0)
        return seen((x, 0.02 + rnd.gauss(0.0, 0.001), 0.1))

    def measured(t):
        ray = place(t)
        return ray._replace(distance=ray.distance * math.exp(rnd.gauss(0.0, 0.05)))

    for t, _, estimator in steps(measured, 50.0):
        if t % 4.0 >= 1.0 and t >= 6.0:  # (while a walk begins or ends the distance may lag)
            found = estimator.estimate.ray_at(t).distance
            assert found == pytest.approx(place(t).distance, rel=0.25)


@pytest.mark.parametrize("distance", [1e-300, 1e12])
def test_no_distance_makes_the_estimate_infinite(distance):
    def spoilt(t):
        ray = circle(t)
        return ray._replace(distance=distance) if t > 3.0 and round(t * RATE) % 7 else ray

    for t, _, estimator in steps(spoilt, 5.0):
        assert all(map(math.isfinite, estimator.estimate.ray_at(t + 0.3)))


def test_a_slow_detector_with_an_outlier_crashes_nothing():
    path = lambda t: at(0.35 if round(t / 1.2) % 10 == 9 else 0.3)  # noqa: E731
    for t, verdict, estimator in steps(path, 48.0, 1 / 1.2, target_timeout=3.0):
        assert verdict.used
        assert estimator.estimate.ray_at(t).pan == pytest.approx(0.3, abs=0.06)


@pytest.mark.parametrize("apart", [0.03, 0.09])
def test_two_points_are_trusted_no_longer_than_they_are_apart(apart):
    estimator = fed(lambda t: at(apart if t else 0.0), 2 / RATE)
    for ahead in (0.1, 0.3, 0.5, 5.0):
        pan = estimator.estimate.ray_at(1 / RATE + ahead).pan
        assert -0.01 < pan < 2.5 * apart


@pytest.mark.parametrize(("late", "allowed"), [(0.12, 0.05), (0.4, 0.12)])
def test_five_points_a_second_of_a_swing_are_enough(late, allowed):
    rnd = random.Random(1)

    def is_off(t):
        return round(5 * t) % 23 == 22

    def measured(t):
        ray = swing(t)
        return at(ray.pan + rnd.gauss(0.0, 0.002) + 0.4 * is_off(t), ray.tilt)

    for t, verdict, estimator in steps(measured, 30.0, 5, late, late + 0.16):
        if t > 6.0:
            assert verdict is (Verdict.JUMP if is_off(t) else Verdict.TAKEN)
            time = estimator.estimate.stamp + late + 0.16
            (pan, tilt, _), there = estimator.estimate.ray_at(time), swing(time)
            missed = math.hypot((pan - there.pan) * math.cos(tilt), tilt - there.tilt)
            assert is_off(t) or missed < allowed


def test_points_of_a_second_slower_camera_are_used_on_a_fast_swing():
    estimator, seldom = TargetEstimator(EstimatorParameters()), []
    points = [(k / 15 + 0.05, k / 15) for k in range(150)]
    points += [(k / 5 + 0.35, k / 5 + 0.01) for k in range(50)]
    for now, stamp in sorted(points):
        verdict = estimator.add(stamp, swing(stamp, 1.0), now)
        if now - stamp > 0.2 and now > 3.0:
            seldom.append(verdict)
    assert seldom.count(Verdict.TAKEN) == len(seldom)


def test_late_points_that_agree_can_confirm_a_jump():
    estimator = fed(lambda t: at(0.0))
    start = estimator.estimate.stamp
    estimator.add(start + 0.2, at(0.0), start + 0.2)
    verdicts = [estimator.add(start + ago, at(0.5), start + 0.21) for ago in (0.18, 0.1, 0.02)]
    assert verdicts[0] is Verdict.JUMP
    assert Verdict.NEW_TARGET in verdicts


@pytest.mark.parametrize("frequency", [0.0, 0.2, 1.0])
def test_stated_deviations_are_those_of_the_predictions(frequency):
    rnd, ahead, squares = random.Random(7), 0.17, []

    def noisy(t):
        ray = swing(t, frequency)
        return at(ray.pan + rnd.gauss(0.0, 0.002), ray.tilt + rnd.gauss(0.0, 0.002))

    for t, _, estimator in steps(noisy, 20.0, lead=ahead):
        if t > 2.0:
            there, estimate = swing(t + ahead, frequency), estimator.estimate
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
        estimator.add(k / RATE, at(0.0, 1.3), k / RATE)
    assert estimator.add(2.0, at(0.12, 1.3), 2.0) is verdict


def test_of_two_persons_who_take_turns_the_known_one_is_believed_at_once():
    path = lambda t: at(0.5 if round(t * RATE) // RATE % 2 else -0.5)  # noqa: E731
    verdicts = [verdict for _, verdict, _ in steps(path, 6.0)]
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
    def poster(t):
        return at(0.5 if t < 1.0 or (t > 3.0 and round(t * RATE) % 20 == 0) else -0.5)

    thrown = sum(
        t > 3.0 and estimator.estimate.ray_at(t).pan > -0.4
        for t, _, estimator in steps(poster, 20.0)
    )
    assert thrown <= 1


def test_a_target_that_is_lost_is_where_its_last_two_points_were():
    """It left the view while its points waited for confirmation; one may be a false detection."""
    estimator = fed(lambda t: at(0.0), 1.0)
    for now, pan in ((1.1, 0.2), (1.2, 0.5)):
        assert estimator.add(now, at(pan), now) is Verdict.JUMP
        assert not estimator.settle(now + 0.3, is_lost=now < 1.15)
    assert estimator.settle(1.6, is_lost=True)
    assert estimator.estimate.ray_at(1.6).pan == pytest.approx(0.5, abs=1e-3)


def test_a_target_that_is_lost_has_not_gone_on_if_its_last_point_was_behind():
    estimator = fed(at, 1.0)
    assert estimator.add(1.1, at(0.8), 1.1) is Verdict.JUMP
    assert not estimator.settle(1.5, is_lost=False)
    assert estimator.settle(1.5, is_lost=True)
    assert estimator.estimate.ray_at(1.5).pan == pytest.approx(0.8, abs=1e-3)


@pytest.mark.parametrize(
    ("suspects", "lookout"),
    [((), 0.0), ((0.3,), 0.0), ((0.5,), 0.1), ((0.5, -0.7), -0.1), ((1.3,), 0.0)],
)
def test_a_camera_that_waits_for_a_lost_target_sees_where_it_may_be(suspects, lookout):
    estimator = fed(lambda t: at(0.0), 1.0)
    for k, pan in enumerate(suspects):
        assert estimator.add(1.1 + 0.1 * k, at(pan), 1.1 + 0.1 * k) is Verdict.JUMP
    assert estimator.in_view().ray_at(2.0).pan == pytest.approx(lookout, abs=2e-3)


def test_a_lost_target_may_have_stopped_on_its_way():
    estimator = fed(lambda t: at(1.2 * t), 1.0)
    last = estimator.estimate.ray.pan
    assert (
        last + 0.3
        < estimator.in_view().ray_at(2.0).pan
        < min(last + 0.45, estimator.estimate.ray_at(2.0).pan - 0.05)
    )


@pytest.mark.parametrize("rate", [15, 30])
def test_a_fast_start_is_followed_without_a_stop(rate):
    rnd = random.Random(1)
    path = lambda t: -1.0 + (1.0 - math.cos(3.5 * min(max(t - 2.0, 0.0), 0.9)))  # noqa: E731
    for t, _, estimator in steps(lambda t: at(path(t) + rnd.gauss(0.0, 0.005)), 4.0, rate):
        assert abs(estimator.estimate.ray_at(t).pan - path(t)) < 0.45


@pytest.mark.parametrize("seed", range(2))
def test_a_target_that_stops_is_not_predicted_on(seed):
    """The mean error 0.1 s ahead, in the 0.6 s after a stop from 1 rad/s."""
    rnd = random.Random(seed)
    missed = [
        abs(estimator.estimate.ray_at(t + 0.1).pan - 2.0)
        for t, _, estimator in steps(lambda t: at(min(t, 2.0) + rnd.gauss(0.0, 0.003)), 2.6, 60)
        if t >= 2.0
    ]
    assert sum(missed) / len(missed) < 0.0163


def test_a_false_detection_after_the_first_point_behind_a_gap_is_no_motion():
    """That point was far from the prediction, and is used: there was time for the way."""
    estimator = fed(lambda t: at(0.7), 2.0, 15, 0.1)
    assert estimator.add(35 / 15.0, at(0.84), 2.43) is Verdict.TAKEN
    pan = estimator.estimate.ray_at(2.4).pan
    assert estimator.add(2.4, at(pan, 0.17), 2.5) is Verdict.JUMP
    assert abs(estimator.estimate.ray_at(2.8).tilt) < 0.02


def test_a_slow_detector_sees_few_outliers_in_a_person_who_starts_and_stops():
    """Five points a second, 400 ms late; moves of minimum jerk between random places."""
    used = []
    for seed in range(4):
        rnd = random.Random(seed)
        move = [0.0, 0.0, 0.0, 1.0]  # from and to [rad], since [s], for [s]

        def person(t, rnd=rnd, move=move):
            start, goal, began, took = move
            if t > began + took + 1.0:
                move[:] = goal, rnd.uniform(-0.6, 0.6), t, rnd.uniform(0.8, 1.6)
                start, goal, began, took = move
            s = min((t - began) / took, 1.0)
            pan = start + (goal - start) * s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
            return at(pan + rnd.gauss(0.0, 0.005), rnd.gauss(0.0, 0.005))

        used += [verdict.used for _, verdict, _ in steps(person, 60.0, 5, 0.4, 0.5)]
    assert sum(used) > 0.955 * len(used)


T, J, NEW = Verdict.TAKEN, Verdict.JUMP, Verdict.NEW_TARGET


@pytest.mark.parametrize(
    ("seconds", "rate", "late", "points", "verdicts", "where"),
    [
        # After a gap the first point is the target: a head that waits loses who walks away.
        (1.0, 30, 0.0, [(0.6, 0.5, 0.0)], [NEW], (0.5, 0.0)),
        (1.0, 30, 0.0, [(20.0, 0.5, 0.0)], [NEW], (0.5, 0.0)),
        # A false detection after a gap: a target that was at rest before is back at once.
        (1.0, 30, 0.0, [(1.0, 0.3, 0.0), (1.0 + 1 / 30, 0.0, 0.0)], [NEW, NEW], (0.0, 0.0)),
        # Two false detections in one direction are a motion; who was at rest may be there still.
        (2.0, 30, 0.0, [(0.1, 0.13, 0), (0.2, 0.26, 0), (0.3, 0, 0)], [J, T, NEW], (0.0, 0.0)),
        # False detections beside a target at rest are no motion.
        (2.0, 15, 0.1, [(0.0, 0.17, -0.24), (0.2, 0.1, 0.0)], [J, J], (0.0, 0.0)),
        (2.0, 15, 0.1, [(0.0, 0.17, -0.24), (0.4, 0.1, 0.24)], [J, J], (0.0, 0.0)),
        (
            *(2.0, 15, 0.1),  # to and fro
            [(0.0, -0.08, -0.13), (0.14, 0.12, -0.17), (0.4, -0.22, -0.21)],
            *([J, J, J], (0.0, 0.0)),
        ),
        # (near each other, but fast)
        (2.0, 15, 0.1, [(0.0, -0.14, 0.19), (0.04, -0.22, 0.2)], [J, J], (0.0, 0.0)),
        # Who walks on after 0.7 s unseen: the speed that was good at rest says nothing any more.
        (4.0, 15, 0.1, [(0.7 - 1 / 15, 0.03, 0), (0.7, 0.09, 0)], [NEW, T], (0.09, 0.0)),
        # A slow detector: the second point of the motion is far from the first.
        (4.0, 5, 0.6, [(0.0, 0.01, 0.0), (0.2, 0.09, 0.0)], [T, T], (0.09, 0.0)),
    ],
)
def test_points_after_a_rest_are_a_motion_or_false_detections(
    seconds, rate, late, points, verdicts, where
):
    """Each at a time [s] since the rest; pan and tilt from the target [rad]."""
    rnd, noise = random.Random(3), 0.003 if seconds == 4.0 else 0.0
    estimator = fed(lambda t: at(0.7 + rnd.gauss(0.0, noise), -0.06), seconds, rate, late)
    for (t, pan, tilt), verdict in zip(points, verdicts, strict=True):
        now = seconds + t
        assert estimator.add(now, at(0.7 + pan, tilt - 0.06), now + late) is verdict
    pan, tilt, _ = estimator.estimate.ray_at(now + (0.0 if verdict is T else 0.5))
    assert (pan - 0.7, tilt + 0.06) == pytest.approx(where, abs=1e-3 if verdict is NEW else 0.02)
