"""Instructions, registers, modes and errors of the simulated servos of both protocols."""

import math
from dataclasses import replace
from operator import attrgetter

import pytest
from hypothesis import given
from hypothesis import strategies as st
from simulated_packets import answer, write

from head_tracking.dynamixel import servo_model
from head_tracking.dynamixel.models import all_models
from head_tracking.dynamixel.protocol import (
    ErrorBits,
    Instruction,
    StatusCode,
    encode_packet,
    read_packet,
    write_packet,
)
from head_tracking.simulation import SimulatedBus, SimulatedServo, models
from head_tracking.simulation.packets import Packet, Status

MS = 1_000_000
SECOND = 1000 * MS
RANGE = Status(1, ErrorBits.RANGE)
XM430 = servo_model("XM430-W350")


@pytest.mark.parametrize(("address", "length"), [(49, 2), (50, 1), (0, 51), (255, 1), (0, 0)])
def test_read_behind_the_table_is_a_range_error(address, length):
    assert answer(SimulatedServo(1), read_packet(1, 1, address, length)) == RANGE


def test_a_new_model_needs_one_row_that_names_the_registers_of_another(monkeypatch):
    theirs = models.registers_of("XM430-W350", 45)
    new = replace(models.simulated_model("XM430-W350"), name="NEW", number=9991)
    monkeypatch.setattr(models, "simulated_model", lambda _: new)
    number, *others = models.registers_of.__wrapped__("NEW", 45)
    assert (number.initial, *others) == (9991, *theirs[1:])
    new = replace(new, registers="NEW")
    with pytest.raises(models.SimulationError):
        models.registers_of.__wrapped__("NEW", 45)


def test_goal_outside_the_angle_limits_is_refused():
    servo = SimulatedServo(1)
    write(servo, "CW Angle Limit", 300)
    write(servo, "CCW Angle Limit", 800)
    for goal in (299, 801):
        assert write(servo, "Goal Position", goal) == ErrorBits.ANGLE_LIMIT
    assert servo.register("Goal Position") == 512
    assert servo.register("Torque Enable") == 0
    for goal in (300, 800):
        assert write(servo, "Goal Position", goal) == 0


@given(
    st.sampled_from(["AX-12", "XM430-W350", "XL-320", "XC330-T288", "STS3215", "SCS0009"]),
    st.integers(0, 255),
    st.binary(max_size=60),
)
def test_no_instruction_makes_a_servo_raise(model, code, parameters):
    servo = SimulatedServo(1, model)
    for servo_id in (1, 254):
        servo.execute(Packet(servo_id, code, parameters), 0)
    servo.advance(5_000_000)
    servo.register("Present Position")


# errors


@pytest.mark.parametrize("model", ["AX-12", "MX-64"])
def test_blocked_servo_shuts_down_and_comes_back_by_its_torque_limit(model):
    servo = SimulatedServo(1, servo_model(model))
    servo.advance(0)
    goal = servo.model.center + 200
    write(servo, "Goal Position", goal)
    servo.drive.impede(1.0)
    servo.advance(3 * SECOND)
    assert servo.register("Torque Limit") == 0
    assert servo.register("Torque Enable") == 1
    servo.drive.impede(0.0)
    servo.advance(60 * SECOND)
    now = 60 * SECOND
    status = answer(servo, read_packet(1, 1, 36, 2), now)
    assert status.error == ErrorBits.OVERLOAD and len(status.data) == 2
    blocked = servo.true_ticks
    assert write(servo, "Goal Position", goal, now) == ErrorBits.OVERLOAD
    servo.advance(now + SECOND)
    assert servo.true_ticks == blocked
    assert write(servo, "Torque Limit", 1023, now + SECOND) == 0
    servo.advance(now + 3 * SECOND)
    assert servo.true_ticks == pytest.approx(goal, abs=6)


# Protocol 2.0


def servo(model=XM430, **options) -> SimulatedServo:
    made = SimulatedServo(1, model, **options)
    made.advance(0)
    return made


@pytest.mark.parametrize(
    ("packet", "code"),
    [
        (write_packet(2, 1, 132, b"\0\0\0\0"), StatusCode.ACCESS),
        (write_packet(2, 1, 3000, b"\0"), StatusCode.ACCESS),
        (write_packet(2, 1, 116, b"\0\0"), StatusCode.DATA_LENGTH),
        (encode_packet(2, 1, 0x33), StatusCode.INSTRUCTION),
        (encode_packet(2, 1, 5), StatusCode.INSTRUCTION),
        (read_packet(2, 1, 5000, 1), StatusCode.ACCESS),
        (write_packet(2, 1, 65, b"\2"), StatusCode.DATA_RANGE),  # LED
        (write_packet(2, 1, 116, bytes((0, 16, 0, 0))), StatusCode.DATA_LIMIT),  # Goal Position
        (write_packet(2, 1, 104, bytes((201, 0, 0, 0))), StatusCode.DATA_LIMIT),  # Goal Velocity
        (write_packet(2, 1, 9, b"\0"), StatusCode.ACCESS),  # EEPROM with torque on
    ],
)
def test_error_codes_of_refused_packets(packet, code):
    s = servo()
    s.set_register("Torque Enable", 1)
    before = s.register("Return Delay Time")
    assert answer(s, packet) == Status(1, code)
    assert s.register("Return Delay Time") == before


@pytest.mark.parametrize(
    ("firmware", "data", "last"), [(None, 208, 20), (52, 208, 20), (53, 224, 28)]
)
def test_indirect_registers_of_the_330_series_are_those_of_its_firmware(firmware, data, last):
    s = servo(servo_model("XL330-M288"), firmware=firmware)
    status = answer(s, read_packet(2, 1, 168 + 2 * (last - 1), 2))  # it stands for its own data
    assert status.data == bytes((data + last - 1, 0))
    assert answer(s, write_packet(2, 1, data + last - 1, b"\1")) == Status(1, 0)
    assert answer(s, read_packet(2, 1, data + last, 1)) == Status(1, StatusCode.ACCESS)
    assert answer(s, encode_packet(2, 1, Instruction.PING)).data[2] == (firmware or 50)


# Bus watchdog


def test_bus_watchdog_trips_in_time_without_calls_of_advance():
    """In simulated time the next packet is the first thing that happens."""
    s, watched = servo(), servo()
    for one in (s, watched):
        write(one, "Torque Enable", 1)
        write(one, "Profile Velocity", 50)
        write(one, "Goal Position", 3500)
        write(one, "Bus Watchdog", 5)
    for now in range(0, 3 * SECOND, 10 * MS):
        watched.advance(now)
    assert write(s, "Goal Position", 100, 3 * SECOND) == StatusCode.DATA_RANGE
    assert s.register("Bus Watchdog") == 255
    assert s.true_ticks == pytest.approx(watched.true_ticks, abs=2)


@pytest.mark.parametrize("setting", [("Operating Mode", 1), ("Drive Mode", 4)])
def test_the_motor_does_not_drive_in_a_mode_that_is_not_simulated(setting):
    s = servo()
    for name, value in (setting, ("Torque Enable", 1), ("Goal Position", 3000)):
        assert write(s, name, value) == 0
    s.advance(SECOND)
    assert s.true_ticks == 2048


# Operating modes


def test_extended_position_mode_counts_turns():
    s = servo()
    write(s, "Operating Mode", 4)
    write(s, "Torque Enable", 1)
    assert write(s, "Goal Position", -6000) == 0
    s.advance(10 * SECOND)
    assert s.register("Present Position") == pytest.approx(-6000, abs=6)


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("model", all_models(), ids=lambda model: model.name)
def test_a_goal_speed_is_kept(model, direction):
    servo = SimulatedServo(1, model)
    servo.advance(0)
    count = round(0.3 * model.no_load_speed / model.speed_unit)
    write(servo, "Torque Enable", 1)
    goal = model.center + direction * round(model.ticks * 0.4)
    data = model.goal.layout.pack(*model.goal_values((goal, count, 0)))
    answer(servo, write_packet(model.protocol, 1, model.goal.address, data))
    way, speed = model.ticks * 0.4 * model.radians_per_tick, count * model.speed_unit
    fastest = 0.0
    for now in range(0, round(0.5 * way / speed * 1e9), 5 * MS):
        servo.advance(now)
        fastest = max(fastest, abs(servo.drive.speed))
    assert servo.drive.speed == pytest.approx(direction * speed, rel=0.06)
    assert fastest <= 1.05 * speed + 0.01


# How it moves; time is passed in


class Bench:
    """A servo and a clock."""

    def __init__(self, servo: SimulatedServo) -> None:
        self.servo = servo
        self.now = 0
        servo.advance(0)

    def go(self, goal: int, speed: int) -> None:
        data = goal.to_bytes(2, "little") + speed.to_bytes(2, "little")
        answer(self.servo, write_packet(1, self.servo.id, 30, data), self.now)

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


def test_step_at_full_speed_arrives_without_ringing():
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


def test_deflection_under_load():
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
def test_the_dead_angle_reads_as_the_nearer_end_of_the_range(model):
    b = Bench(SimulatedServo(1, model))
    read = {}
    for torque in (0.3, -0.3):
        b.servo.drive.push(torque)
        for _ in range(200):
            b.run(0.01)
            degrees = math.degrees(b.servo.true_position) % 360.0
            read.setdefault(int(degrees // 30.0), set()).add(b.servo.register("Present Position"))
    assert read[5] == {1023}  # 150 to 180 degrees
    assert read[6] == {0}
    assert len(read[0]) > 10


def test_motion_does_not_depend_on_the_calls_of_advance():
    often, rarely = bench(), bench()
    for b in (often, rarely):
        b.go(900, 150)
    for now in range(0, SECOND, 370_000):
        often.servo.advance(now)
    often.servo.advance(SECOND)
    rarely.servo.advance(SECOND)
    assert often.servo.true_position == rarely.servo.true_position
    assert often.servo.drive.speed == rarely.servo.drive.speed


def test_time_at_rest_is_skipped():
    b = bench()
    b.go(600, 0)
    b.servo.advance(10**18)  # thirty years in steps of a millisecond would not end
    assert b.servo.at_rest
    assert b.servo.true_ticks == pytest.approx(600, abs=1.5)


@pytest.mark.parametrize(("gear", "link"), [(0.02, 0.0), (0.0, 0.02), (0.03, 0.01)])
def test_encoder_and_link_stay_behind_by_half_of_the_play_on_either_side(gear, link):
    b, rotor = bench(), 0.0
    b.servo.drive.mechanics.gear_play, b.servo.drive.mechanics.link_play = gear, link
    for goal, side in ((600, 1.0), (430, -1.0)):
        b.go(goal, 100)
        rotor += 1e-3 * sum(b.run(2.5, "drive.speed"))
        assert rotor - b.servo.drive.angle == pytest.approx(side * gear / 2.0, abs=1e-9)
        assert b.servo.drive.angle - b.servo.true_position == pytest.approx(side * link / 2.0)
        assert b.servo.register("Present Position") == pytest.approx(goal, abs=2)


@pytest.mark.parametrize("volts", [9.6, 12.0])
def test_torque_falls_with_the_supply(volts):
    """The heaviest load that it still lifts is in proportion to its supply."""

    def lifts(share):
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
def test_coupled_shafts_turn_together_however_often_the_bus_is_simulated(gap):
    bus = SimulatedBus([SimulatedServo(1), SimulatedServo(2)])
    bus.couple(1, 2)
    bus.advance(SECOND)
    bus[1].lead(700.0, 0.1)
    for now in range(SECOND, 2 * SECOND, gap):
        bus.advance(now)
    bus.advance(2 * SECOND)
    assert bus[1].true_position > 0.7
    assert bus[2].true_position == pytest.approx(-bus[1].true_position, abs=0.01)
