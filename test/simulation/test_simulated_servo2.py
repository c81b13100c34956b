"""Instructions, modes and errors of servos with protocol 2.0."""

from __future__ import annotations

import pytest
from simulated_packets import InstructionPacket2, StatusPacket2, write

from head_tracking.dynamixel.models import servo_model
from head_tracking.dynamixel.protocol import StatusCode
from head_tracking.simulation import SimulatedServo

Packet = InstructionPacket2
MS = 1_000_000
SECOND = 1000 * MS
XM430 = servo_model("XM430-W350")
XL430 = servo_model("XL430-W250")


def servo(model=XM430, **options) -> SimulatedServo:
    made = SimulatedServo(1, model, **options)
    made.advance(0)
    return made


def test_error_codes_of_refused_packets() -> None:
    s = servo()
    assert s.execute(Packet.write(1, 132, b"\0\0\0\0"), 0) == StatusPacket2(1, StatusCode.ACCESS)
    assert s.execute(Packet.write(1, 3000, b"\0"), 0) == StatusPacket2(1, StatusCode.ACCESS)
    assert s.execute(Packet.write(1, 116, b"\0\0"), 0) == StatusPacket2(1, StatusCode.DATA_LENGTH)
    assert s.execute(Packet(1, 0x33), 0) == StatusPacket2(1, StatusCode.INSTRUCTION)
    assert s.execute(Packet(1, 5), 0) == StatusPacket2(1, StatusCode.INSTRUCTION)
    assert s.execute(Packet.read(1, 5000, 1), 0) == StatusPacket2(1, StatusCode.ACCESS)
    assert write(s, "LED", 2) == StatusCode.DATA_RANGE
    assert write(s, "Goal Position", 4096) == StatusCode.DATA_LIMIT
    assert write(s, "Goal Velocity", 201) == StatusCode.DATA_LIMIT
    write(s, "Torque Enable", 1)
    assert write(s, "Return Delay Time", 0) == StatusCode.ACCESS  # EEPROM with torque on
    assert s.register("Return Delay Time") == 250


@pytest.mark.parametrize(
    ("firmware", "data", "last"), [(None, 208, 20), (52, 208, 20), (53, 224, 28)]
)
def test_indirect_registers_of_the_330_series_are_those_of_its_firmware(
    firmware, data, last
) -> None:
    s = servo(servo_model("XL330-M288"), firmware=firmware)
    status = s.execute(Packet.read(1, 168 + 2 * (last - 1), 2), 0)  # it stands for its own data
    assert status is not None and status.data == bytes((data + last - 1, 0))
    assert s.execute(Packet.write(1, data + last - 1, b"\1"), 0) == StatusPacket2(1)
    assert s.execute(Packet.read(1, data + last, 1), 0) == StatusPacket2(1, StatusCode.ACCESS)
    reported = s.execute(Packet.ping(1), 0)
    assert reported is not None and reported.data[2] == (firmware or 50)


# Bus watchdog


def test_bus_watchdog_trips_in_time_without_calls_of_advance() -> None:
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


# Operating modes


@pytest.mark.parametrize("setting", [("Operating Mode", 1), ("Drive Mode", 4)])
def test_the_motor_does_not_drive_in_a_mode_that_is_not_simulated(setting) -> None:
    s = servo()
    for name, value in (setting, ("Torque Enable", 1), ("Goal Position", 3000)):
        assert write(s, name, value) == 0
    s.advance(SECOND)
    assert s.true_ticks == 2048


def test_extended_position_mode_counts_turns() -> None:
    s = servo()
    write(s, "Operating Mode", 4)
    write(s, "Torque Enable", 1)
    assert write(s, "Goal Position", -6000) == 0
    s.advance(10 * SECOND)
    assert s.register("Present Position") == pytest.approx(-6000, abs=6)


def test_enabling_torque_resets_the_turns() -> None:
    s = servo()
    s.lead(6000, 2.0, 2.0)
    s.advance(4 * SECOND)
    assert s.register("Present Position") == pytest.approx(6000, abs=20)
    write(s, "Torque Enable", 1, 4 * SECOND)
    assert s.register("Present Position") == pytest.approx(6000 - 4096, abs=20)


def test_enabling_torque_starts_a_motion_to_the_former_goal() -> None:
    """X servos do; a driver must set the goal to where the servo stands before."""
    s = servo()
    write(s, "Goal Position", 3000)
    s.advance(SECOND)
    assert s.true_ticks == 2048
    write(s, "Torque Enable", 1, SECOND)
    s.advance(3 * SECOND)
    assert s.true_ticks == pytest.approx(3000, abs=5)


def test_reverse_mode_mirrors_position_and_velocity() -> None:
    s = servo(position=1000)
    write(s, "Drive Mode", 1)
    assert s.register("Present Position") == 4096 - 1000
    write(s, "Torque Enable", 1)
    write(s, "Goal Position", 4000)
    s.advance(300 * MS)
    assert s.register("Present Velocity") > 0
    assert s.drive.speed < 0
    s.advance(3 * SECOND)
    assert s.register("Present Position") == pytest.approx(4000, abs=5)


@pytest.mark.parametrize(
    ("acceleration", "velocity", "goal", "top", "rise"),
    [
        (16, 100, 3500, 100, 400),  # a trapezoid: 64 v / a
        (10, 200, 2148, None, None),  # a short distance: a triangle
    ],
)
def test_profiles(acceleration, velocity, goal, top, rise) -> None:
    s = servo()
    for name, value in (
        ("Torque Enable", 1),
        ("Profile Acceleration", acceleration),
        ("Profile Velocity", velocity),
        ("Goal Position", goal),
    ):
        write(s, name, value)
    speeds = []
    for now in range(0, 5 * SECOND, MS):
        s.advance(now)
        speeds.append(s.register("Velocity Trajectory"))
    assert s.register("Present Position") == pytest.approx(goal, abs=5)
    assert speeds[-1] == s.register("Moving") == 0
    if top is None:
        assert 10 < max(speeds) < 100
    else:
        assert max(speeds) == pytest.approx(top, rel=0.02)
        assert speeds.index(max(speeds)) == pytest.approx(rise, abs=12)
