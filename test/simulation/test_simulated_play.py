"""Play, stick-slip and supply of a simulated servo, with values that are known."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from simulated_packets import InstructionPacket

from head_tracking.simulation import SimulatedServo, SimulationError

MS = 1_000_000
DEGREE = math.pi / 180.0
GOAL, SPEED = 30, 32  # addresses of an AX-12
SPEED_UNIT = 0.111 * 2.0 * math.pi / 60.0  # rad/s


class Bench:
    """An AX-12 and a clock.

    Args:
        options: of the servo.
    """

    def __init__(self, **options: float | None) -> None:
        self.servo = SimulatedServo(1, position=512.0, **options)
        self.now = 0
        self.servo.advance(0)

    def go(self, goal: int, speed: int, seconds: float) -> list[tuple[float, float]]:
        """Move; return the angles of encoder and link [rad] in each millisecond."""
        for address, value in ((SPEED, speed), (GOAL, goal)):
            packet = InstructionPacket.write(1, address, value.to_bytes(2, "little"))
            self.servo.execute(packet, self.now)
        path = []
        for _ in range(round(1e3 * seconds)):
            self.now += MS
            self.servo.advance(self.now)
            path.append((self.servo.encoder_position, self.servo.true_position))
        return path


@pytest.mark.parametrize("degrees", [0.0, 0.5, 1.0, 2.0])
def test_the_link_ends_elsewhere_from_either_side_by_the_play_behind_the_encoder(
    degrees: float,
) -> None:
    b = Bench(link_play=degrees * DEGREE)
    (shaft, link) = b.go(600, 100, 1.5)[-1]
    assert shaft - link == pytest.approx(0.5 * degrees * DEGREE, abs=1e-9)
    (shaft, link) = b.go(430, 100, 2.5)[-1]
    assert link - shaft == pytest.approx(0.5 * degrees * DEGREE, abs=1e-9)


def test_the_link_stands_while_the_shaft_crosses_its_play() -> None:
    b = Bench(link_play=2.0 * DEGREE)
    path = b.go(600, 100, 1.5)
    assert max(shaft for shaft, link in path if link == 0.0) == pytest.approx(1 * DEGREE, rel=0.05)


def reversal(play: float) -> float:
    """Return how long the encoder takes to turn back by 0.05 degrees, at 60 units of speed [s]."""
    b = Bench(gear_play=play)
    end = b.go(600, 60, 2.5)[-1][0]
    path = b.go(430, 60, 1.5)
    return next(k for k, (shaft, _) in enumerate(path) if shaft < end - 0.05 * DEGREE) * 1e-3


@pytest.mark.parametrize("degrees", [0.5, 1.0, 2.0])
def test_the_encoder_stands_while_the_motor_crosses_its_play(degrees: float) -> None:
    crossing = degrees * DEGREE / (60 * SPEED_UNIT)
    later = reversal(degrees * DEGREE) - reversal(0.0)
    assert crossing < later < crossing + 0.02  # the motor has to get up to speed


@pytest.mark.parametrize("degrees", [0.5, 2.0])
def test_the_encoder_reaches_the_goal_in_spite_of_play_before_it(degrees: float) -> None:
    b = Bench(gear_play=degrees * DEGREE)
    shaft, link = b.go(430, 60, 3.0)[-1]
    assert shaft == link
    assert abs(b.servo.register("Present Position") - 430) <= 1  # the default margin


def standing(stiction: float | None) -> float:
    """Return the share of a creep at the second-lowest speed in which the shaft stands."""
    b = Bench(stiction=stiction)
    path = [shaft for shaft, _ in b.go(560, 2, 3.0)][500:]
    return sum(before == after for before, after in pairwise(path)) / (len(path) - 1)


def test_slow_motion_sticks_and_slips_with_much_stiction() -> None:
    assert standing(None) < 0.01
    assert standing(0.2) > 0.3


@pytest.mark.parametrize("volts", [9.6, 12.0])
def test_torque_falls_with_the_supply(volts: float) -> None:
    """The heaviest load that it still lifts is in proportion to its supply."""

    def lifts(share: float) -> bool:
        b = Bench(supply_voltage=volts)
        b.servo.push(-share * b.servo.model.stall_torque * volts / b.servo.model.nominal_voltage)
        return b.go(600, 0, 0.3)[-1][0] > 0.0

    assert lifts(0.9)
    assert not lifts(1.05)


@pytest.mark.parametrize("name", ["gear_play", "link_play", "stiction"])
@pytest.mark.parametrize("value", [-0.01, math.inf, math.nan])
def test_what_makes_no_sense_is_refused(name: str, value: float) -> None:
    with pytest.raises(SimulationError):
        SimulatedServo(1, **{name: value})
