"""What is learned of a servo from its commands and its encoder."""

import math
from itertools import pairwise

import pytest

from head_tracking.tracking.servo_model import ShaftModel

TICK = 0.00511
DT = 0.02


class Servo:
    """A set-point that moves as commanded, later by a delay, a dead band, an encoder with steps."""

    def __init__(self, delay, resolution=TICK, band=0.0):
        self.delay, self.resolution, self.band = delay, resolution, band
        self.shaft, self.setpoint, self.time = 0.0, 0.0, -1.0
        self.commands = []

    def command(self, time, speed):
        self.commands.append((time + self.delay, speed))

    def encoder(self, time):
        while self.time < time:
            self.time += 0.0005
            speeds = [speed for start, speed in self.commands[-30:] if start <= self.time]
            self.setpoint += (speeds[-1] if speeds else 0.0) * 0.0005
            low, high = self.setpoint - self.band, self.setpoint + self.band
            self.shaft = min(max(self.shaft, low), high)
        return round(self.shaft / self.resolution) * self.resolution


def swing(servo, seconds=6.0, speed=lambda t: 1.5 * math.cos(3.0 * t)):
    model = ShaftModel()
    model.restart(0.0, 0.0)
    t, k = 0.0, 0
    while t < seconds:
        k += 1
        t = k * DT
        model.measured(t - 0.01, servo.encoder(t - 0.01))
        servo.command(t, speed(t))
        model.command(t, speed(t), math.copysign(10.0, speed(t)))
    return model, t


@pytest.mark.parametrize("delay", [0.0, 0.07, 0.3])
@pytest.mark.parametrize("resolution", [TICK, 0.0005])
def test_the_delay_is_learned_and_known_to_be(delay, resolution):
    model, _ = swing(Servo(delay, resolution), 10.0)
    assert model.mean == pytest.approx(delay, abs=0.012 if delay == 0.0 else 0.006)
    assert model.delay == pytest.approx(model.mean, abs=0.003)
    assert model.deviation < 0.03


@pytest.mark.parametrize("band", [0.0, 0.003, 0.006])
def test_a_dead_band_is_told_from_a_delay(band):
    model, _ = swing(Servo(0.06, 0.0005, band))
    assert model.mean == pytest.approx(0.06, abs=0.008)
    assert model.dead_band == pytest.approx(band, abs=0.003)


def test_a_new_mean_is_applied_without_a_jump():
    servo, model = Servo(0.25), ShaftModel()
    model.restart(0.0, 0.0)
    delays = []
    for k in range(1, 400):
        t = k * DT
        model.measured(t - 0.01, servo.encoder(t - 0.01))
        speed = 1.5 * math.cos(3.0 * t)
        servo.command(t, speed)
        model.command(t, speed, math.copysign(10.0, speed))
        delays.append(model.delay)
    steps = [abs(b - a) for a, b in pairwise(delays)]
    assert delays[-1] == pytest.approx(0.25, abs=0.01)
    assert max(steps) < 0.003


def test_a_held_servo_stays():
    model = ShaftModel()
    model.restart(0.0, 0.0)
    model.command(0.0, -1.0, -2.0)
    model.hold(0.1, -0.1)
    assert model.setpoint(3.0) == pytest.approx(-0.1)


class LimitedServo(Servo):
    """A shaft that follows its set-point with a lag of 25 ms and a limited acceleration."""

    def __init__(self, delay, limit):
        super().__init__(delay)
        self.limit, self.speed = limit, 0.0

    def encoder(self, time):
        while self.time < time:
            self.time += 0.002
            speeds = [speed for start, speed in self.commands[-30:] if start <= self.time]
            self.setpoint += (speeds[-1] if speeds else 0.0) * 0.002
            change = (self.setpoint - self.shaft) / 0.025 - self.speed
            self.speed += min(max(change, -self.limit * 0.002), self.limit * 0.002)
            self.shaft += self.speed * 0.002
        return round(self.shaft / self.resolution) * self.resolution


def kinks(t):
    return 1.0 if t % 1.2 < 0.6 else -1.0


@pytest.mark.parametrize("delay", [0.02, 0.1])
@pytest.mark.parametrize("limit", [5.0, 20.0])
def test_the_acceleration_of_a_weak_shaft_is_found(delay, limit):
    model, _ = swing(LimitedServo(delay, limit), 6.0, speed=kinks)
    assert 0.5 * limit < model.acceleration < 1.6 * limit


@pytest.mark.parametrize("delay", [0.02, 0.2])
def test_a_shaft_that_follows_is_given_more_acceleration(delay):
    model, _ = swing(LimitedServo(delay, 150.0), 6.0, speed=kinks)
    assert model.acceleration > 1.2 * ShaftModel().acceleration


def test_a_shaft_that_was_thrown_off_is_met_where_it_will_be():
    servo = LimitedServo(0.02, 5.0)
    model, t = swing(servo, 6.0, speed=kinks)
    assert model.astray(t) is None
    servo.shaft += 0.4  # it stands still there, and comes back
    servo.speed = 0.0
    met = []
    for _ in range(20):
        t += DT
        model.measured(t - 0.01, servo.encoder(t - 0.01))
        servo.command(t, 0.0)
        model.command(t, 0.0, 0.0)
        if (found := model.astray(t)) is not None:
            met.append((found, t + model.delay))
    assert met
    (position, speed), _ = met[len(met) // 2]
    assert position < servo.setpoint + 0.45
    assert speed < 0.0


@pytest.mark.parametrize("lag", [0.0, 0.1, 1.0])
def test_late_readings_are_judged_across_the_shift_of_the_buffer(lag):
    model = ShaftModel()
    model.restart(0.0, 0.0)
    for step in range(1, 1200):  # the buffer holds 10 s
        now = step * DT
        model.command(now, math.cos(now), math.copysign(10.0, math.cos(now)))
        if now > lag:
            model.measured(now - lag, math.sin(now - lag))
    assert math.isfinite(model.delay)
