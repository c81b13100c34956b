import math

import pytest

from head_tracking.tracking.servo_model import ServoModel

TICK = 0.00511


class Servo:
    """A setpoint that moves as told, later by a delay, and an encoder with steps."""

    def __init__(self, delay, resolution=TICK):
        self.delay, self.resolution, self.history = delay, resolution, [(-1.0, 0.0)]

    def command(self, time, speed):
        self.history.append((time + self.delay, speed))

    def position(self, time):
        total = 0.0
        for (start, speed), (end, _) in zip(
            self.history, [*self.history[1:], (math.inf, 0.0)], strict=True
        ):
            if start < time:
                total += speed * (min(end, time) - max(start, -1.0))
        return total

    def encoder(self, time):
        return round(self.position(time) / self.resolution) * self.resolution


def swing(delay, seconds=6.0, first=0.04, resolution=TICK):
    servo, response = Servo(delay, resolution), ServoModel(0.0, 0.0, delay=first)
    for k in range(1, int(seconds * 50)):
        t = k * 0.02
        response.measured(t - 0.01, servo.encoder(t - 0.01))
        speed = 1.5 * math.cos(3.0 * t)
        servo.command(t, speed)
        response.commanded(t, speed, math.copysign(10.0, speed))
    return servo, response, t


@pytest.mark.parametrize("delay", [0.02, 0.04, 0.07, 0.1])
def test_the_delay_is_learned(delay):
    _, response, _ = swing(delay, 10.0)
    assert response.delay == pytest.approx(delay, abs=0.012)


def test_a_finer_encoder_is_recognised():
    assert swing(0.04, resolution=0.00153)[1].resolution == pytest.approx(0.00153, rel=0.01)
    assert swing(0.04)[1].resolution == pytest.approx(TICK, rel=0.01)


def test_the_shaft_is_expected_where_it_is():
    servo, response, t = swing(0.04)
    assert response.expected(t) == pytest.approx(servo.position(t), abs=3 * TICK)


def test_a_wall_stops_the_setpoint():
    response = ServoModel(0.0, 0.0)
    response.commanded(0.0, 1.0, 0.3)
    assert response.setpoint(0.1) == pytest.approx(0.1)
    assert response.setpoint(5.0) == pytest.approx(0.3)


def test_a_held_servo_stays():
    response = ServoModel(0.0, 0.0)
    response.commanded(0.0, -1.0, -2.0)
    response.held(0.1, -0.1)
    assert response.setpoint(3.0) == pytest.approx(-0.1)


def test_a_blocked_shaft_teaches_no_delay():
    response = ServoModel(0.0, 0.0, delay=0.04)
    for k in range(1, 100):
        response.commanded(0.02 * k, 1.0 + 0.5 * math.sin(k), 10.0)
        response.measured(0.02 * k + 0.01, 0.0)
    assert response.delay == 0.04


def test_old_readings_are_ignored():
    response = ServoModel(1.0, 0.5)
    response.measured(0.5, 9.0)
    assert response.reading == (1.0, 0.5)
