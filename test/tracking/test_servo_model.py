"""What is learned of a servo from its commands and its encoder."""

import math

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
