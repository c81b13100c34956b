"""How the simulated servo moves. Time is passed in: nothing here waits."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import pytest
from simulated_packets import InstructionPacket

from head_tracking.dynamixel import JointConfiguration, servo_model
from head_tracking.simulation import SimulatedServo
from head_tracking.simulation.motion import Hand, Temperature, compliance_law

AX_12 = servo_model("AX-12")
TICK = AX_12.radians_per_tick
MS = 1_000_000
SECOND = 1000 * MS


class Bench:
    """A servo and a clock."""

    def __init__(self, servo: SimulatedServo) -> None:
        self.servo = servo
        self.now = 0
        servo.advance(0)

    def write(self, name: str, value: int) -> None:
        register = AX_12.control_table[name]
        data = value.to_bytes(register.size, "little")
        self.servo.execute(InstructionPacket.write(self.servo.id, register.address, data), self.now)

    def go(self, goal: int, speed: int) -> None:
        data = goal.to_bytes(2, "little") + speed.to_bytes(2, "little")
        self.servo.execute(InstructionPacket.write(self.servo.id, 30, data), self.now)

    def run(
        self, seconds: float, look: Callable[[SimulatedServo], float] | None = None
    ) -> list[float]:
        seen = []
        end = self.now + round(seconds * SECOND)
        while self.now < end:
            self.now += MS
            self.servo.advance(self.now)
            if look is not None:
                seen.append(look(self.servo))
        return seen


def bench(position: float = 512.0) -> Bench:
    return Bench(SimulatedServo(1, position=position))


def ticks(servo: SimulatedServo) -> float:
    return servo.true_ticks


def velocity(servo: SimulatedServo) -> float:
    return servo.true_velocity


def test_nothing_moves_without_a_command() -> None:
    b = bench()
    assert set(b.run(1.0, ticks)) == {512.0}


def test_step_at_full_speed_arrives_without_ringing() -> None:
    b = bench()
    b.go(610, 0)
    path = b.run(0.5, ticks)
    assert max(path) < 610 + 3  # overshoot: under a degree
    assert path[150] > 512 + 0.9 * 98  # 90 % within 150 ms
    assert abs(path[-1] - 610) <= 1.0  # the default margin
    turns = sum(
        1 for a, b, c in zip(path, path[1:], path[2:], strict=False) if (b - a) * (c - b) < 0
    )
    assert turns <= 1


def test_speed_rises_with_finite_acceleration() -> None:
    b = bench(100)
    b.go(900, 0)
    speeds = b.run(0.3, velocity)
    fastest = AX_12.no_load_speed / 0.04 * 0.001  # first order with 40 ms, per ms
    assert max(c - a for a, c in pairwise(speeds)) < fastest
    assert speeds[39] == pytest.approx(0.63 * AX_12.no_load_speed, rel=0.05)


def test_a_heavier_load_takes_longer_to_get_going() -> None:
    b = bench(100)
    b.servo.inertia *= 2.0
    b.go(900, 0)
    speeds = b.run(0.3, velocity)
    assert speeds[79] == pytest.approx(0.63 * AX_12.no_load_speed, rel=0.05)


def test_speed_zero_goes_as_fast_as_the_servo_can() -> None:
    b = bench(50)
    b.go(1000, 0)
    assert max(b.run(1.0, velocity)) == pytest.approx(AX_12.no_load_speed, rel=0.01)


def test_speed_falls_with_the_supply() -> None:
    b = Bench(SimulatedServo(1, position=50, supply_voltage=9.6))
    b.go(1000, 0)
    fastest = max(b.run(1.0, velocity))
    assert fastest == pytest.approx(0.8 * AX_12.no_load_speed, rel=0.02)


@pytest.mark.parametrize("speed", [5, 50, 172, 400])
@pytest.mark.parametrize("direction", [1, -1])
def test_moving_speed_is_kept(speed: int, direction: int) -> None:
    b = bench()
    b.go(512 + direction * 400, speed)
    wanted = speed * AX_12.speed_unit
    speeds = b.run(0.4, velocity)
    assert max(abs(v) for v in speeds) <= wanted * 1.05 + 0.01
    steady = speeds[250:350]
    assert sum(steady) / len(steady) == pytest.approx(direction * wanted, rel=0.05)


def test_slowest_speed_creeps() -> None:
    b = bench()
    b.go(600, 1)
    b.run(10.0)
    wanted = 10.0 * AX_12.speed_unit / TICK
    assert b.servo.true_ticks - 512 == pytest.approx(wanted, abs=2.0)


def test_moving_speed_is_kept_after_a_blockade() -> None:
    b = bench()
    b.go(900, 50)
    b.run(0.3)
    b.servo.push(-1.6)  # more than the servo can do
    b.run(1.0)
    b.servo.push(0.0)
    speeds = b.run(0.5, velocity)
    assert max(speeds) < 50 * AX_12.speed_unit * 1.5


@pytest.mark.parametrize(("slope", "goal"), [(4, 600), (32, 600), (128, 600), (254, 200)])
def test_every_slope_arrives(slope: int, goal: int) -> None:
    b = bench()
    b.write("CW Compliance Slope", slope)
    b.write("CCW Compliance Slope", slope)
    b.go(goal, 100)
    b.run(4.0)
    assert b.servo.true_ticks == pytest.approx(goal, abs=3.0)


@pytest.mark.parametrize(
    ("register", "band"),
    [(1, 2), (3, 2), (4, 4), (7, 4), (8, 8), (16, 16), (32, 32), (63, 32), (64, 64), (128, 128),
     (254, 128)],
)  # fmt: skip
def test_slope_register_has_seven_steps(register: int, band: int) -> None:
    law = compliance_law(1.0, (1, 1), (register, 8), 0.0, 1.0)
    assert (law.cw_slope, law.ccw_slope) == (band, 8)


def test_no_drive_within_the_margin() -> None:
    b = bench()
    b.write("CW Compliance Margin", 10)
    b.write("CCW Compliance Margin", 10)
    b.go(521, 0)
    assert set(b.run(0.5, ticks)) == {512.0}
    b.go(524, 0)
    b.run(0.5)
    assert 513 < b.servo.true_ticks < 520


def test_loaded_servo_gives_way_by_the_slope() -> None:
    b = bench()
    b.go(512, 0)
    b.servo.push(-0.75)  # half the stall torque
    b.run(2.0)
    sag = 512 - b.servo.true_ticks
    assert sag == pytest.approx(1 + 32 * (0.5 - 32 / 1023), abs=1.5)  # margin + half the slope
    load = b.servo.register("Present Load")
    assert load == pytest.approx(512, abs=30)  # counter-clockwise: bit 10 clear


def test_load_has_bit_10_when_clockwise() -> None:
    b = bench()
    b.go(512, 0)
    b.servo.push(0.75)
    b.run(2.0)
    assert b.servo.register("Present Load") == pytest.approx(1024 + 512, abs=30)


def test_speed_has_bit_10_when_clockwise() -> None:
    b = bench()
    b.go(112, 100)
    b.run(0.5)
    assert b.servo.register("Present Speed") == pytest.approx(1024 + 100, abs=3)
    b.go(912, 100)
    b.run(0.5)
    assert b.servo.register("Present Speed") == pytest.approx(100, abs=3)


def test_torque_limit_limits_the_drive() -> None:
    b = bench()
    b.write("Torque Limit", 102)  # 10 %
    b.go(512, 0)
    b.servo.push(0.3)  # 20 %
    b.run(5.0)
    assert b.servo.true_ticks > 900


def test_torque_limit_zero_lets_go() -> None:
    b = bench()
    b.write("Torque Limit", 0)
    b.go(700, 0)
    assert set(b.run(0.5, ticks)) == {512.0}


def test_moving_flag() -> None:
    b = bench()
    assert b.servo.register("Moving") == 0
    b.go(600, 100)
    b.run(0.1)
    assert b.servo.register("Moving") == 1
    b.run(1.0)
    assert b.servo.register("Moving") == 0


def test_position_is_quantised_but_the_truth_is_not() -> None:
    b = bench()
    b.go(600, 37)
    b.run(0.35)
    assert b.servo.true_ticks != round(b.servo.true_ticks)
    assert b.servo.register("Present Position") == round(b.servo.true_ticks)


def test_torque_off_stops_driving_and_keeps_the_position() -> None:
    b = bench()
    b.go(900, 200)
    b.run(0.3)
    b.write("Torque Enable", 0)
    b.run(1.0)
    resting = b.servo.true_ticks
    assert resting < 800
    assert set(b.run(1.0, ticks)) == {resting}


def test_torque_on_starts_for_the_old_goal() -> None:
    """Real servos do: the driver has to pin the goal first."""
    b = bench()
    b.go(700, 0)
    b.run(0.5)
    b.write("Torque Enable", 0)
    b.servo.lead(300, 0.5)
    b.run(1.0)
    b.write("Torque Enable", 1)
    b.run(1.0)
    assert b.servo.true_ticks == pytest.approx(700, abs=1.5)


def test_relaxed_shaft_follows_a_hand_and_stays() -> None:
    b = bench()
    b.servo.lead(300, 0.5)
    b.run(1.5)
    assert b.servo.true_ticks == pytest.approx(300, abs=1.5)
    assert b.servo.at_rest


def test_hand_leads_at_its_pace() -> None:
    b = bench()
    b.servo.lead(712, 1.0)
    path = b.run(1.0, ticks)
    assert path[499] == pytest.approx(612, abs=5)


def test_servo_with_torque_on_resists_a_hand() -> None:
    b = bench()
    b.go(512, 0)
    b.servo.lead(300, 0.5)
    furthest = min(b.run(0.7, ticks))
    assert 490 < furthest < 508
    b.run(1.0)
    assert b.servo.true_ticks == pytest.approx(512, abs=1.5)


def test_small_push_does_not_overcome_friction() -> None:
    b = bench()
    b.servo.push(0.04)
    assert set(b.run(0.5, ticks)) == {512.0}


@pytest.mark.parametrize("model", ["AX-12", "XL-320"])
def test_the_dead_angle_reads_as_the_nearer_end_of_the_scale(model: str) -> None:
    b = Bench(SimulatedServo(1, model))
    read: dict[int, set[int]] = {}
    for torque in (0.3, -0.3):
        b.servo.push(torque)
        for _ in range(200):
            b.run(0.01)
            degrees = math.degrees(b.servo.true_position) % 360.0
            read.setdefault(int(degrees // 30.0), set()).add(b.servo.register("Present Position"))
    assert read[5] == {1023}  # 150 to 180 degrees
    assert read[6] == {0}
    assert len(read[0]) > 10


def test_a_servo_led_through_its_dead_angle_goes_on_the_same_way() -> None:
    b = bench()
    b.servo.lead(1200, 1.0)
    b.run(1.3)
    assert b.servo.register("Present Position") == 0
    b.write("Goal Position", 100)
    b.run(3.0)
    assert b.servo.register("Present Position") == pytest.approx(100, abs=3)
    assert b.servo.true_ticks == pytest.approx(1024 * 1.2 + 100, abs=3)


def test_wheel_mode_turns_without_end() -> None:
    b = bench()
    b.write("CCW Angle Limit", 0)
    b.write("Moving Speed", 512)
    travelled = sum(v * 0.001 for v in b.run(5.0, velocity))
    assert travelled > 2 * math.pi
    b.write("Moving Speed", 1024 + 512)
    assert b.run(1.0, velocity)[-1] < -1.0


def test_motion_does_not_depend_on_how_often_one_looks() -> None:
    often, rarely = bench(), bench()
    for b in (often, rarely):
        b.go(900, 150)
    for now in range(0, SECOND, 370_000):
        often.servo.advance(now)
    often.servo.advance(SECOND)
    rarely.servo.advance(SECOND)
    assert often.servo.true_position == rarely.servo.true_position
    assert often.servo.true_velocity == rarely.servo.true_velocity


def test_time_at_rest_is_skipped() -> None:
    b = bench()
    b.go(600, 0)
    b.servo.advance(10**18)  # thirty years in steps of a millisecond would not end
    assert b.servo.at_rest
    assert b.servo.true_ticks == pytest.approx(600, abs=1.5)


def test_time_that_stands_still_changes_nothing() -> None:
    b = bench()
    b.go(600, 0)
    b.run(0.05)
    before = b.servo.true_position
    b.servo.advance(b.now - SECOND)
    b.servo.advance(b.now)
    assert b.servo.true_position == before


def test_stalled_servo_gets_hot_and_cools_down() -> None:
    b = bench()
    assert b.servo.temperature == pytest.approx(30.0)
    b.servo.set_register("Shutdown", 0)
    b.go(900, 0)
    b.servo.push(-1.6)
    b.now += 60 * SECOND
    b.servo.advance(b.now)
    hot = b.servo.temperature
    assert 40.0 < hot < 70.0
    b.write("Torque Enable", 0)
    b.servo.push(0.0)
    b.now += 600 * SECOND
    b.servo.advance(b.now)
    assert 30.0 < b.servo.temperature < hot - 5.0


def test_temperature_does_not_depend_on_the_step() -> None:
    once, often = Temperature(), Temperature()
    once.heat(0.5, 100.0)
    for _ in range(100):
        often.heat(0.5, 1.0)
    assert once.celsius == pytest.approx(often.celsius, rel=1e-9)


def test_hand_lets_go() -> None:
    hand = Hand(start=0, duration=SECOND, origin=0.0, target=1.0, strength=0.5)
    assert hand.holds(SECOND)
    assert not hand.holds(2 * SECOND)


@pytest.mark.parametrize("reverse", [False, True])
def test_true_ticks_give_the_true_joint_position(reverse: bool) -> None:
    low, high = (1023, 0) if reverse else (0, 1023)
    joint = JointConfiguration("joint", 1, controller="controller", init=512, min=low, max=high)
    servo = SimulatedServo(1, position=700.25)
    sign = -1 if reverse else 1
    assert joint.position(servo.true_ticks) == pytest.approx(sign * servo.true_position)
