"""How the simulated servo moves. Time is passed in: nothing here waits."""

import math
from operator import attrgetter

import pytest
from simulated_packets import InstructionPacket, write

from head_tracking.dynamixel import servo_model
from head_tracking.simulation import SimulatedBus, SimulatedServo

AX_12 = servo_model("AX-12")
MS = 1_000_000
SECOND = 1000 * MS


class Bench:
    """A servo and a clock."""

    def __init__(self, servo: SimulatedServo) -> None:
        self.servo = servo
        self.now = 0
        servo.advance(0)

    def write(self, name: str, value: int) -> None:
        write(self.servo, name, value, self.now)

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


@pytest.mark.parametrize("model", ["AX-12", "XM430-W350", "STS3215"])
def test_a_relaxed_shaft_does_not_coast_far(model: str) -> None:
    b = Bench(SimulatedServo(1, model))
    b.servo.drive.push(0.25 * b.servo.model.stall_torque)
    while b.servo.drive.speed < 1.0:
        b.run(0.001)
    released = b.servo.true_position
    b.servo.drive.push(0.0)
    b.run(3.0)
    assert b.servo.drive.speed == 0.0
    assert math.degrees(b.servo.true_position - released) < 5.0


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


def test_wheel_mode_turns_without_end() -> None:
    b = bench()
    b.write("CCW Angle Limit", 0)
    b.write("Moving Speed", 512)
    travelled = sum(v * 0.001 for v in b.run(5.0, "drive.speed"))
    assert travelled > 2 * math.pi
    b.write("Moving Speed", 1024 + 512)
    assert b.run(1.0, "drive.speed")[-1] < -1.0


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


def test_time_at_rest_is_skipped() -> None:
    b = bench()
    b.go(600, 0)
    b.servo.advance(10**18)  # thirty years in steps of a millisecond would not end
    assert b.servo.at_rest
    assert b.servo.true_ticks == pytest.approx(600, abs=1.5)


@pytest.mark.parametrize("degrees", [0.0, 2.0])
def test_link_play_shifts_the_link_by_half_to_either_side(
    degrees: float,
) -> None:
    b = bench(link_play=math.radians(degrees))
    for goal, sign in ((600, 1.0), (430, -1.0)):
        b.go(goal, 100)
        b.run(2.5)
        play = sign * (b.servo.drive.angle - b.servo.true_position)
        assert play == pytest.approx(0.5 * math.radians(degrees), abs=1e-9)


@pytest.mark.parametrize("volts", [9.6, 12.0])
def test_torque_falls_with_the_supply(volts: float) -> None:
    """The heaviest load that it still lifts is in proportion to its supply."""

    def lifts(share: float) -> bool:
        b = bench(supply_voltage=volts)
        b.servo.drive.push(
            -share * b.servo.model.stall_torque * volts / b.servo.model.nominal_voltage
        )
        b.go(600, 0)
        b.run(0.3)
        return b.servo.drive.angle > 0.0

    assert lifts(0.9)
    assert not lifts(1.05)


@pytest.mark.parametrize("gap", [1_000_000, 700_000, 100_000_000])
def test_coupled_shafts_turn_together_however_often_the_bus_is_simulated(gap: int) -> None:
    bus = SimulatedBus([SimulatedServo(1), SimulatedServo(2)])
    bus.couple(1, 2)
    bus.advance(SECOND)
    bus[1].lead(700.0, 0.1)
    for now in range(SECOND, 2 * SECOND, gap):
        bus.advance(now)
    bus.advance(2 * SECOND)
    assert bus[1].true_position > 0.7
    assert bus[2].true_position == pytest.approx(-bus[1].true_position, abs=0.01)
