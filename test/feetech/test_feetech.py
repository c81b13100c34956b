"""Feetech servos: packets as their maker prints them (ftservo-wiki 9522ce1), and known troubles."""

from dataclasses import replace

import pytest
from dynamixel_fakes import submit
from simulated_device import Rig, joint_of

from head_tracking.configuration.bus_parameters import (
    ControllerParameters,
    MotorParameters,
    SecondMotorParameters,
    configured_joint,
)
from head_tracking.configuration.simulated import SimulatedJoints
from head_tracking.dynamixel import (
    ConfigurationError,
    EepromSettings,
    EventKind,
    Goal,
    JointConfiguration,
    Torque,
    check_configuration,
    servo_model,
)
from head_tracking.dynamixel.protocol import (
    encode_packet,
    read_packet,
    sync_read_packet,
    sync_write_packet,
    write_packet,
)
from head_tracking.dynamixel.servo import run
from head_tracking.feetech import FeetechErrors
from head_tracking.simulation import SimulatedBus, SimulatedServo

STS = servo_model("STS3215")
SPEED_1000 = bytes.fromhex("00 08 00 00 E8 03")  # position 2048, time 0, 1000 steps/s
OK = "FF FF 01 02 00 FC"
AT_1304 = "FF FF 01 0A 00 18 05 00 00 00 00 77 23 3D"  # 11.9 V, 35 degrees
AT_2047 = "FF FF 02 0A 00 FF 07 00 00 00 00 77 23 53"

VECTORS = {
    "ping": ("FF FF 01 02 01 FB", encode_packet(1, 1, 0x01), [OK]),
    "read position": (
        *("FF FF 01 04 02 38 02 BE", read_packet(1, 1, 56, 2)),
        ["FF FF 01 04 00 18 05 DD"],
    ),
    "write id": ("FF FF FE 04 03 05 01 F4", write_packet(1, 254, 5, b"\x01"), []),
    "write goal": (
        *("FF FF 01 09 03 2A 00 08 00 00 E8 03 D5", write_packet(1, 1, 42, SPEED_1000)),
        [OK],
    ),
    "sync write": (
        "FF FF FE 20 83 2A 06 01 00 08 00 00 E8 03 02 00 08 00 00 E8 03 "
        "03 00 08 00 00 E8 03 04 00 08 00 00 E8 03 58",
        sync_write_packet(1, 42, dict.fromkeys((1, 2, 3, 4), SPEED_1000)),
        [],
    ),
    "sync read": (
        *("FF FF FE 06 82 38 08 01 02 36", sync_read_packet(1, (1, 2), 56, 8)),
        [AT_1304, AT_2047],
    ),
}


@pytest.mark.parametrize(("printed", "ours", "answers"), VECTORS.values(), ids=VECTORS)
def test_driver_and_simulated_servos_send_what_the_maker_prints(printed, ours, answers):
    assert ours == bytes.fromhex(printed)
    servos = [SimulatedServo(1, STS, position=1304), SimulatedServo(2, STS, position=2047)]
    for servo in servos:
        servo.supply_voltage, servo.temperature = 11.9, 35.0
    answered = [answer.data for answer in SimulatedBus(servos).receive(ours, 0)]
    assert answered == [bytes.fromhex(answer) for answer in answers]
    if SPEED_1000 in ours:
        names = ("Goal Position", "Moving Speed", "Torque Enable")
        assert [servos[0].register(name) for name in names] == [2048, 1000, 1]


def test_values_of_scs_servos_have_the_high_byte_first():
    scs = servo_model("SCS0009")
    values = scs.goal_values((0x0123, 0x0245, 0))
    assert scs.goal.encode(*values) == bytes.fromhex("01 23 00 00 02 45")
    assert scs.control_table.block("Model Number").layout.unpack(b"\x05\x04") == (1284,)


def test_what_is_written_under_the_lock_is_forgotten_at_power_off():
    servo = SimulatedServo(1, STS)
    bus = SimulatedBus([servo])
    bus.receive(write_packet(1, 1, 13, b"\x3c"), 0)
    assert servo.register("Temperature Limit") == 60
    servo.power_off()
    servo.power_on()
    assert servo.register("Temperature Limit") == 70
    bus.receive(write_packet(1, 1, 55, b"\0"), 1_000_000_000)
    bus.receive(write_packet(1, 1, 13, b"\x3c"), 1_000_000_000)
    servo.power_off()
    servo.power_on()
    assert servo.register("Temperature Limit") == 60


# What users of Feetech servos have met, and what becomes of it here


SCS = servo_model("SCS0009")
JOINT = JointConfiguration("pan", 1, 2048, 1024, 3072, controller="pan", model=STS)


def rig_of(servo: SimulatedServo, joint: JointConfiguration = JOINT) -> Rig:
    return Rig(servo, joints=[joint])


# Offsets (lerobot issue 1296: "Magnitude 2114 exceeds 2047")


@pytest.mark.parametrize(("model", "offset"), [(STS, 2048), (STS, -2048), (SCS, 10)])
def test_an_offset_that_a_model_cannot_have_is_refused(model, offset):
    with pytest.raises(ConfigurationError):
        replace(joint_of(1, model), offset=offset)


def test_a_memory_that_is_being_written_when_the_bus_is_closed_is_locked():
    rig = rig_of(SimulatedServo(1, STS, eeprom_time=0.006))
    submit(rig.bus, rig.bus.writing_eeprom("pan", EepromSettings(return_delay=100.0)))
    for _ in range(20):
        if rig.servos[0].register("EEPROM Lock"):
            rig.step()
    assert rig.servos[0].register("EEPROM Lock") == 0
    assert rig.bus.close() == ()
    assert rig.servos[0].register("EEPROM Lock") == 1


def test_a_memory_whose_writing_is_interrupted_is_locked():
    rig = rig_of(SimulatedServo(1, STS))

    def interrupt(_):
        assert rig.servos[0].register("EEPROM Lock") == 0
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as kept:  # as an interactive session keeps it
        run(rig.bus.writing_eeprom("pan", EepromSettings(return_delay=100.0)), interrupt)
    assert rig.servos[0].register("EEPROM Lock") == 1
    assert kept.traceback


def test_a_memory_that_a_killed_program_was_writing_is_locked_at_the_next_start():
    rig = rig_of(SimulatedServo(1, STS))
    rig.bus.close()
    rig.servos[0].set_register("EEPROM Lock", 0)
    rig.bus.connect()
    assert rig.servos[0].register("EEPROM Lock") == 1


def test_a_calibration_that_fits_is_used_again_after_a_restart():
    servo = SimulatedServo(1, STS)
    servo.set_offset(-85)
    for _ in range(2):
        rig = rig_of(servo, replace(JOINT, offset=-85))
        assert rig.go(0.4).states["pan"].position == pytest.approx(0.4, abs=0.02)
        assert rig.bus.close() == ()
        servo = SimulatedServo(1, STS, position=servo.true_ticks - 85, boot_time=0.0)
        servo.set_offset(-85)


# A calibration that is not that of the servo (lerobot issues 1342, 1360)


def test_the_offset_comes_from_the_parameters_of_the_joint():
    controller = ControllerParameters(joint_name="pan")
    motor = MotorParameters(model="STS3215", id=1, init=2048, min=1024, max=3072)
    none = SecondMotorParameters()
    assert configured_joint("pan", controller, motor, none).offset is None
    joint = configured_joint("pan", controller, replace(motor, offset=-85), none)
    assert joint.offset == -85
    simulated = SimulatedJoints([joint])  # its servo has that memory
    assert simulated.true_position("pan") == pytest.approx(0.0, abs=1e-9)
    assert simulated.use(lambda bus: bus[1].register("Position Offset")) == 2048 + 85


# Power (SO-ARM100 issue 132: brown-outs reset servos or misplace them)


def test_a_brown_out_is_named_and_nothing_moves_until_a_command():
    servo = SimulatedServo(1, STS, boot_time=0.3)
    rig = rig_of(servo)
    rig.go(0.5)
    servo.power_off()
    servo.power_on()
    servo.lead(2048, 1.0)  # it falls meanwhile
    rig.step(250)
    fallen = servo.true_position
    assert fallen < 0.2
    rig.step(25)
    assert {EventKind.LOST, EventKind.TORQUE_LOST, EventKind.RETURNED} & set(rig.kinds)
    assert rig.servos[0].true_position == pytest.approx(fallen, abs=1e-3)
    assert rig.bus.joint("pan").torque is Torque.OFF_UNTIL_COMMANDED
    assert rig.reading.states["pan"].position == pytest.approx(fallen, abs=0.01)
    rig.go(0.2)
    goals = [write.goal for write in rig.bench.bus.writes if "Goal Position" in write.names]
    first = goals[len(goals) - goals[::-1].index(2048 + round(0.5 / JOINT.resolution)) :][0]
    assert first == pytest.approx(2048 + fallen / JOINT.resolution, abs=3)  # from where it stands
    assert rig.reading.states["pan"].position == pytest.approx(0.2, abs=0.02)


def test_a_servo_for_7_volts_on_12_is_reported_and_works_all_the_same():
    """lerobot issue 1010: the voltage bit in every reply was read as a failure."""
    joint = replace(JOINT, model=servo_model("STS3215-C001"))
    rig = rig_of(SimulatedServo(1, "STS3215-C001", supply_voltage=12.0), joint)
    assert rig.go(0.4).states["pan"].position == pytest.approx(0.4, abs=0.02)
    assert rig.bus.servos[0].errors == FeetechErrors.INPUT_VOLTAGE
    assert EventKind.ALARM in rig.kinds and EventKind.FAULTED not in rig.kinds


def test_torque_off_is_obeyed_and_not_a_failure_while_an_overload_is_reported():
    """lelamp_runtime issue 9: torque off was answered with the overload bit."""
    servo = SimulatedServo(1, STS)
    servo.set_register("Shutdown", 0)  # it drives on with its holding torque
    rig = rig_of(servo)
    rig.go(0.3)
    rig.servos[0].overload()
    rig.servos[0].alarms.forced = int(FeetechErrors.OVERLOAD)
    rig.step(10)
    assert rig.bus.servos[0].errors == FeetechErrors.OVERLOAD
    run(rig.bus.switching_torque(None, False))
    assert rig.servos[0].register("Torque Enable") == 0
    assert rig.bus.joint("pan").torque is Torque.OFF_ON_REQUEST


# One line


@pytest.mark.parametrize("other", ["SCS0009", "AX-12", "XM430-W350"])
def test_families_that_cannot_share_a_line_are_refused(other):
    model = servo_model(other)
    center = model.center
    tilt = JointConfiguration(
        "tilt", 2, center, center - 100, center + 100, controller="tilt", model=model
    )
    with pytest.raises(ConfigurationError):
        check_configuration([JOINT, tilt])


def test_no_goal_speed_is_read_as_full_speed():
    """Below 0.732 rpm an STS servo has no speed but 0, which is full speed."""
    rig = rig_of(SimulatedServo(1, STS))
    rig.bus.command({"pan": Goal(0.5, 0.001)})
    rig.step(25)
    speeds = [write.speed for write in rig.bench.bus.writes if write.goal]
    assert min(speeds) >= 50
    assert rig.servos[0].true_position < 0.1


def test_a_goal_resets_the_acceleration_that_another_program_left():
    servo = SimulatedServo(1, STS)
    servo.set_register("Acceleration", 10)
    rig = rig_of(servo)
    rig.go(0.5)
    assert servo.register("Acceleration") == 0
    assert rig.reading.states["pan"].position == pytest.approx(0.5, abs=0.02)
