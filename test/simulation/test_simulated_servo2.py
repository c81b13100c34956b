"""Instructions, modes and errors of servos with protocol 2.0."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulated_golden_vectors import INSTRUCTIONS_2, STATUSES_2
from simulated_packets import InstructionPacket2, StatusPacket2

from head_tracking.dynamixel.models import servo_model
from head_tracking.dynamixel.protocol import ALERT, HardwareErrors, StatusCode, XL320Errors
from head_tracking.simulation import SimulatedServo

Packet = InstructionPacket2
MS = 1_000_000
SECOND = 1000 * MS
XM430 = servo_model("XM430-W350")
XL430 = servo_model("XL430-W250")
XL320 = servo_model("XL-320")


def servo(model=XM430, **options) -> SimulatedServo:
    made = SimulatedServo(1, model, **options)
    made.advance(0)
    return made


def write(servo: SimulatedServo, name: str, value: int, now: int = 0) -> int:
    register = servo_model(servo.model.name).control_table[name]
    data = value.to_bytes(register.size, "little", signed=value < 0)
    status = servo.execute(Packet.write(servo.id, register.address, data), now)
    assert status is not None
    return status.error


def golden(name: str) -> InstructionPacket2:
    return INSTRUCTIONS_2[name][1]


def test_golden_instructions_get_golden_answers() -> None:
    s = servo(firmware=0x26)
    s.set_register("Model Number", 0x0406)  # the vendor's example has this one
    assert s.execute(golden("ping 1"), 0) == STATUSES_2["ping of an XM430"][1]
    s.set_register("Model Number", 1020)
    for name in ("goal 512", "torque on"):
        assert s.execute(golden(name), 0) == STATUSES_2["ok"][1], name
    s = servo(position=166)
    assert s.execute(golden("read position"), 0) == STATUSES_2["position 166"][1]
    assert servo().execute(golden("reboot 1"), 0) == STATUSES_2["ok"][1]


def test_stuffed_values_arrive_whole() -> None:
    s = servo()
    write(s, "Operating Mode", 4)
    goal = -(256**2) * 2 - 1  # FF FF FD FF: stuffed on the wire
    assert (
        b"\xff\xff\xfd\xfd"
        in Packet.write(1, 116, goal.to_bytes(4, "little", signed=True)).encode()
    )
    assert write(s, "Goal Position", goal) == 0
    assert s.register("Goal Position") == goal


def test_refusals_have_the_vendors_numbers() -> None:
    s = servo()
    assert s.execute(Packet.write(1, 132, b"\0\0\0\0"), 0) == StatusPacket2(1, StatusCode.ACCESS)
    assert s.execute(Packet.write(1, 3000, b"\0"), 0) == StatusPacket2(1, StatusCode.ACCESS)
    assert s.execute(Packet.write(1, 116, b"\0\0"), 0) == StatusPacket2(1, StatusCode.DATA_LENGTH)
    assert s.execute(Packet(1, 0x33), 0) == StatusPacket2(1, StatusCode.INSTRUCTION)
    assert s.execute(Packet.action(1), 0) == StatusPacket2(1, StatusCode.INSTRUCTION)
    assert s.execute(Packet.read(1, 5000, 1), 0) == StatusPacket2(1, StatusCode.ACCESS)
    assert write(s, "LED", 2) == StatusCode.DATA_RANGE
    assert write(s, "Goal Position", 4096) == StatusCode.DATA_LIMIT
    assert write(s, "Goal Velocity", 201) == StatusCode.DATA_LIMIT
    write(s, "Torque Enable", 1)
    assert write(s, "Return Delay Time", 0) == StatusCode.ACCESS  # EEPROM with torque on
    assert s.register("Return Delay Time") == 250


def test_xl320_takes_eeprom_with_torque_on() -> None:
    s = servo(XL320)
    write(s, "Torque Enable", 1)
    assert write(s, "Return Delay Time", 0) == StatusCode.OK


@pytest.mark.parametrize(
    ("level", "ping", "reading", "writing"),
    [(0, True, False, False), (1, True, True, False), (2, True, True, True)],
)
def test_status_return_level(level: int, ping: bool, reading: bool, writing: bool) -> None:
    s = servo()
    s.set_register("Status Return Level", level)
    assert (s.execute(Packet.ping(1), 0) is not None) == ping
    assert (s.execute(Packet.read(1, 0, 2), 0) is not None) == reading
    assert (s.execute(Packet.write(1, 65, b"\x01"), 0) is not None) == writing
    assert s.register("LED") == 1


def test_reboot_forgets_ram_and_is_deaf_for_a_while() -> None:
    s = servo(boot_time=0.3)
    write(s, "Torque Enable", 1)
    write(s, "Profile Velocity", 50)
    assert s.execute(Packet.reboot(1), 0) == StatusPacket2(1)
    assert s.execute(Packet.ping(1), 299 * MS) is None
    assert s.execute(Packet.ping(1), 300 * MS) is not None
    assert s.register("Torque Enable") == s.register("Profile Velocity") == 0


def test_indirect_data_stands_for_other_registers() -> None:
    s = servo(position=1000)
    for number, address in enumerate((132, 133, 146, 65)):
        assert write(s, f"Indirect Address {number + 1}", address) == 0
    status = s.execute(Packet.read(1, 224, 4), 0)
    assert status is not None and status.data == b"\xe8\x03" + bytes((30, 0))
    assert s.execute(Packet.write(1, 227, b"\1"), 0) == StatusPacket2(1)
    assert s.register("LED") == 1
    assert s.execute(Packet.write(1, 226, b"\1"), 0) == StatusPacket2(1, StatusCode.ACCESS)


@pytest.mark.parametrize(
    ("firmware", "data", "last"), [(None, 208, 20), (52, 208, 20), (53, 224, 28)]
)
def test_indirect_registers_of_the_330_series_are_those_of_its_firmware(
    firmware, data, last
) -> None:
    s = servo(servo_model("XL330-M288"), position=1000, firmware=firmware)
    for number, address in ((1, 132), (2, 133), (last, 146)):
        place = 168 + 2 * (number - 1)
        assert s.execute(Packet.write(1, place, bytes((address, 0))), 0) == StatusPacket2(1)
    status = s.execute(Packet.read(1, data, 2), 0)
    assert status is not None and status.data == b"\xe8\x03"
    status = s.execute(Packet.read(1, data + last - 1, 1), 0)
    assert status is not None and status.data == bytes((30,))
    assert s.execute(Packet.read(1, data + last, 1), 0) == StatusPacket2(1, StatusCode.ACCESS)
    reported = s.execute(Packet.ping(1), 0)
    assert reported is not None and reported.data[2] == (firmware or 50)


# Errors


@pytest.mark.parametrize(
    ("model", "errors"), [(XM430, HardwareErrors), (XL320, XL320Errors)], ids=["XM430", "XL-320"]
)
def test_overload_switches_off_until_the_reboot(model, errors) -> None:
    s = servo(model)
    write(s, "Torque Enable", 1)
    s.overload()
    assert s.register("Torque Enable") == 0
    assert s.register("Hardware Error Status") == errors.OVERLOAD
    status = s.execute(Packet.ping(1), 0)
    assert status is not None and status.error == ALERT
    assert write(s, "Torque Enable", 1) & ALERT
    s.advance(MS)
    assert s.register("Torque Enable") == 0
    s.execute(Packet.reboot(1), MS)
    assert s.register("Hardware Error Status") == 0
    assert write(s, "Torque Enable", 1, SECOND) == 0


def test_blocked_servo_shuts_itself_down() -> None:
    s = servo(XL430)
    write(s, "Torque Enable", 1)
    s.push(-5.0)
    write(s, "Goal Position", 3000)
    s.advance(3 * SECOND)
    assert s.register("Hardware Error Status") == HardwareErrors.OVERLOAD
    assert s.register("Torque Enable") == 0


def test_error_outside_the_shutdown_mask_warns_while_it_lasts() -> None:
    s = servo()
    write(s, "Torque Enable", 1)
    s.supply_voltage = 9.0
    assert write(s, "LED", 1) == ALERT
    assert s.register("Hardware Error Status") == HardwareErrors.INPUT_VOLTAGE
    assert s.register("Torque Enable") == 1
    s.supply_voltage = 12.0
    assert write(s, "LED", 0) == 0


def test_forced_errors_are_possible() -> None:
    s = servo()
    write(s, "Torque Enable", 1)
    s.alarms.forced = int(HardwareErrors.ENCODER)
    s.advance(MS)
    assert s.register("Hardware Error Status") == HardwareErrors.ENCODER
    s.alarms.forced = int(HardwareErrors.ELECTRICAL_SHOCK)
    s.advance(2 * MS)
    assert s.register("Torque Enable") == 0


def test_overheating_shuts_down() -> None:
    s = servo()
    write(s, "Torque Enable", 1)
    s.temperature = 81.0
    s.advance(MS)
    assert s.register("Torque Enable") == 0
    assert s.register("Hardware Error Status") == HardwareErrors.OVERHEATING


# Bus watchdog


def test_bus_watchdog_stops_the_servo_and_blocks_goals() -> None:
    s = servo()
    write(s, "Torque Enable", 1)
    write(s, "Profile Velocity", 50)
    write(s, "Goal Position", 3500)
    write(s, "Bus Watchdog", 5)
    s.advance(100 * MS)
    assert s.register("Bus Watchdog") == 5
    s.advance(500 * MS)
    assert s.register("Bus Watchdog") == 255
    stopped = s.true_ticks
    s.advance(3 * SECOND)
    assert s.true_ticks == pytest.approx(stopped, abs=20)
    assert write(s, "Goal Position", 3500, 3 * SECOND) == StatusCode.DATA_RANGE
    assert write(s, "Bus Watchdog", 0, 3 * SECOND) == 0
    assert write(s, "Goal Position", 3500, 3 * SECOND) == 0


def test_bus_watchdog_is_content_with_any_packet() -> None:
    s = servo()
    write(s, "Torque Enable", 1)
    write(s, "Bus Watchdog", 5)
    for now in range(0, SECOND, 90 * MS):
        s.advance(now)
        s.execute(Packet.ping(1), now)
    assert s.register("Bus Watchdog") == 5


def test_bus_watchdog_trips_when_it_should_though_nobody_looks() -> None:
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


def test_bus_watchdog_does_not_watch_a_relaxed_servo() -> None:
    s = servo()
    write(s, "Bus Watchdog", 1)
    assert write(s, "LED", 1, SECOND) == 0
    assert s.register("Bus Watchdog") == 1


def test_old_firmware_has_no_bus_watchdog() -> None:
    s = servo(firmware=37)
    assert write(s, "Torque Enable", 1) == 0
    assert s.execute(Packet.write(1, 98, b"\x05"), 0) == StatusPacket2(1, StatusCode.ACCESS)
    assert s.execute(Packet.read(1, 98, 1), 0) == StatusPacket2(1, 0, b"\0")
    s.advance(SECOND)
    assert s.register("Torque Enable") == 1
    assert servo(firmware=38).execute(Packet.write(1, 98, b"\x05"), 0) == StatusPacket2(1)


# Operating modes


def test_velocity_mode_turns_without_end() -> None:
    s = servo()
    write(s, "Operating Mode", 1)
    write(s, "Torque Enable", 1)
    assert s.register("Goal Velocity") == 0
    write(s, "Goal Velocity", -100)
    s.advance(5 * SECOND)
    assert s.register("Present Velocity") == pytest.approx(-100, abs=2)
    assert s.register("Present Position") < -4096


def test_extended_position_mode_counts_turns() -> None:
    s = servo()
    write(s, "Operating Mode", 4)
    write(s, "Torque Enable", 1)
    assert write(s, "Goal Position", -6000) == 0
    s.advance(10 * SECOND)
    assert s.register("Present Position") == pytest.approx(-6000, abs=6)


def test_position_is_folded_into_one_turn_when_torque_comes_on() -> None:
    s = servo()
    s.lead(6000, 2.0, 2.0)
    s.advance(4 * SECOND)
    assert s.register("Present Position") == pytest.approx(6000, abs=20)
    write(s, "Torque Enable", 1, 4 * SECOND)
    assert s.register("Present Position") == pytest.approx(6000 - 4096, abs=20)


def test_torque_on_goes_for_the_old_goal() -> None:
    """X servos do; a driver must set the goal to where the servo stands before."""
    s = servo()
    write(s, "Goal Position", 3000)
    s.advance(SECOND)
    assert s.true_ticks == 2048
    write(s, "Torque Enable", 1, SECOND)
    s.advance(3 * SECOND)
    assert s.true_ticks == pytest.approx(3000, abs=5)


def test_goal_switches_torque_on_only_if_drive_mode_says_so() -> None:
    s = servo()
    write(s, "Goal Position", 2000)
    assert s.register("Torque Enable") == 0
    write(s, "Drive Mode", 8)
    write(s, "Goal Position", 2000)
    assert s.register("Torque Enable") == 1


def test_reverse_mode_mirrors_position_and_velocity() -> None:
    s = servo(position=1000)
    write(s, "Drive Mode", 1)
    assert s.register("Present Position") == 4096 - 1000
    write(s, "Torque Enable", 1)
    write(s, "Goal Position", 4000)
    s.advance(300 * MS)
    assert s.register("Present Velocity") > 0
    assert s.true_velocity < 0
    s.advance(3 * SECOND)
    assert s.register("Present Position") == pytest.approx(4000, abs=5)


def test_homing_offset_moves_the_zero() -> None:
    s = servo()
    write(s, "Homing Offset", 100)
    assert s.register("Present Position") == 2148


def test_pwm_and_current_drive() -> None:
    for mode, name, value in ((16, "Goal PWM", 442), (0, "Goal Current", 400)):
        s = servo()
        write(s, "Operating Mode", mode)
        write(s, "Torque Enable", 1)
        s.advance(SECOND)
        assert s.true_velocity == 0.0
        write(s, name, value, SECOND)
        s.advance(2 * SECOND)
        assert s.true_velocity > 1.0


# Profiles


def path(s: SimulatedServo, seconds: float, start: int = 0) -> list[float]:
    seen = []
    for now in range(start, start + round(seconds * SECOND), MS):
        s.advance(now)
        seen.append(s.register("Velocity Trajectory"))
    return seen


def test_trapezoid_rises_for_64_v_over_a() -> None:
    s = servo()
    write(s, "Torque Enable", 1)
    write(s, "Profile Acceleration", 16)
    write(s, "Profile Velocity", 100)
    write(s, "Goal Position", 3500)
    speeds = path(s, 1.0)
    rise = next(ms for ms, speed in enumerate(speeds) if speed >= 100)
    assert rise == pytest.approx(64 * 100 / 16, abs=6)
    assert max(speeds) == 100
    s.advance(5 * SECOND)
    assert s.register("Moving") == 0
    assert s.register("Present Position") == pytest.approx(3500, abs=5)


def test_short_way_makes_a_triangle() -> None:
    s = servo()
    write(s, "Torque Enable", 1)
    write(s, "Profile Acceleration", 10)
    write(s, "Profile Velocity", 200)
    write(s, "Goal Position", 2148)
    speeds = path(s, 1.5)
    assert 10 < max(speeds) < 100
    assert speeds[-1] == 0


def test_time_based_profile_takes_its_time() -> None:
    s = servo()
    write(s, "Drive Mode", 4)
    write(s, "Torque Enable", 1)
    write(s, "Profile Acceleration", 300)
    write(s, "Profile Velocity", 1000)
    write(s, "Goal Position", 3048)
    speeds = path(s, 1.5)
    end = max(ms for ms, speed in enumerate(speeds) if speed)
    assert end == pytest.approx(1000, abs=25)
    top = 1000 * XM430.radians_per_tick / 0.7 / XM430.speed_unit
    assert max(speeds) == pytest.approx(top, rel=0.02)


def test_start_delay_delays_the_start_and_not_the_end_of_torque() -> None:
    s = servo(start_delay=0.04)
    write(s, "Torque Enable", 1)
    write(s, "Goal Position", 3000)
    s.advance(39 * MS)
    assert s.true_ticks == 2048
    s.advance(200 * MS)
    assert s.true_ticks > 2050
    write(s, "Torque Enable", 0, 200 * MS)
    s.advance(210 * MS)
    assert abs(s.register("Present PWM")) == 0


def test_position_noise_is_read_and_not_true() -> None:
    s = servo(position_noise=2.0)
    seen = {s.register("Present Position") for _ in range(100)}
    assert len(seen) > 4
    assert s.true_ticks == 2048


def test_servo_is_deaf_while_it_writes_its_eeprom() -> None:
    s = servo(eeprom_time=0.006)
    assert write(s, "Return Delay Time", 0) == 0  # answered at once
    assert s.execute(Packet.ping(1), 5 * MS) is None
    assert s.execute(Packet.ping(1), 6 * MS) is not None
    assert write(s, "LED", 1, 7 * MS) == 0
    assert s.execute(Packet.ping(1), 7 * MS) is not None


def test_power_comes_and_goes() -> None:
    s = servo(position=1000, boot_time=0.1)
    write(s, "Torque Enable", 1)
    s.power_off()
    assert s.execute(Packet.ping(1), MS) is None
    s.lead(1500, 0.5)
    s.advance(2 * SECOND)
    s.power_on()
    assert s.execute(Packet.ping(1), 2 * SECOND + 50 * MS) is None
    assert s.execute(Packet.ping(1), 2 * SECOND + 100 * MS) is not None
    assert s.register("Torque Enable") == 0
    assert s.register("Goal Position") == s.register("Present Position") != 1000


@settings(deadline=None)
@given(
    st.sampled_from([XM430, XL320, servo_model("XC330-T288")]),
    st.integers(0, 255),
    st.binary(max_size=60),
)
def test_no_instruction_makes_a_servo_raise(model, instruction: int, parameters: bytes) -> None:
    s = SimulatedServo(1, model)
    for servo_id in (1, 254):
        s.execute(Packet(servo_id, instruction, parameters), 0)
    s.advance(5_000_000)
    s.register("Present Position")
