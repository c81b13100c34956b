"""How the simulated servo moves. Time is passed in: nothing here waits."""

import math
from operator import attrgetter

import pytest
from simulated_packets import InstructionPacket

from head_tracking.simulation import SimulatedServo

MS = 1_000_000
SECOND = 1000 * MS


class Bench:
    """A servo and a clock."""

    def __init__(self, servo: SimulatedServo) -> None:
        self.servo = servo
        self.now = 0
        servo.advance(0)

    def go(self, goal: int, speed: int) -> None:
        data = goal.to_bytes(2, "little") + speed.to_bytes(2, "little")
        self.servo.execute(InstructionPacket.write(self.servo.id, 30, data), self.now)

    def run(self, seconds: float, what: str = "true_ticks") -> list[float]:
        """Let time pass; return an attribute of the servo at every millisecond."""
        seen = []
        for _ in range(round(seconds * 1e3)):
            self.now += MS
            self.servo.advance(self.now)
            seen.append(attrgetter(what)(self.servo))
        return seen


def bench(**options: float) -> Bench:
    return Bench(SimulatedServo(1, **options))


def test_step_at_full_speed_arrives_without_ringing() -> None:
    b = bench()
    b.go(610, 0)
    path = b.run(0.5)
    assert max(path) < 610 + 3  # overshoot: under a degree
    assert path[150] > 512 + 0.9 * 98  # 90 % within 150 ms
    assert abs(path[-1] - 610) <= 1.0  # the default margin
    turns = sum(
        1 for a, b, c in zip(path, path[1:], path[2:], strict=False) if (b - a) * (c - b) < 0
    )
    assert turns <= 1


def test_deflection_under_load() -> None:
    b = bench()
    b.go(512, 0)
    b.servo.drive.push(-0.75)  # half the stall torque
    b.run(2.0)
    sag = 512 - b.servo.true_ticks
    assert sag == pytest.approx(1 + 32 * (0.5 - 32 / 1023), abs=1.5)  # margin + half the slope
    assert b.servo.register("Present Load") == pytest.approx(512, abs=30)
    b.servo.drive.push(0.75)
    b.run(2.0)
    assert b.servo.register("Present Load") == pytest.approx(1024 + 512, abs=30)  # clockwise


@pytest.mark.parametrize("model", ["AX-12", "XL-320"])
def test_the_dead_angle_reads_as_the_nearer_end_of_the_range(model: str) -> None:
    b = Bench(SimulatedServo(1, model))
    read: dict[int, set[int]] = {}
    for torque in (0.3, -0.3):
        b.servo.drive.push(torque)
        for _ in range(200):
            b.run(0.01)
            degrees = math.degrees(b.servo.true_position) % 360.0
            read.setdefault(int(degrees // 30.0), set()).add(b.servo.register("Present Position"))
    assert read[5] == {1023}  # 150 to 180 degrees
    assert read[6] == {0}
    assert len(read[0]) > 10


def test_motion_does_not_depend_on_the_calls_of_advance() -> None:
    often, rarely = bench(), bench()
    for b in (often, rarely):
        b.go(900, 150)
    for now in range(0, SECOND, 370_000):
        often.servo.advance(now)
    often.servo.advance(SECOND)
    rarely.servo.advance(SECOND)
    assert often.servo.true_position == rarely.servo.true_position
    assert often.servo.drive.speed == rarely.servo.drive.speed
