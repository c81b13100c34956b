"""Faults, heat, watchdogs, timeouts; joints stopped, started and changed while running."""

import pytest
from dynamixel_fakes import PAN, TILT, TORQUE, FakeRig, speed_ticks, submit, writes
from simulated_device import Rig

from head_tracking.dynamixel import (
    BusSettings,
    ConfigurationError,
    EepromSettings,
    EventKind,
    Goal,
    GoalError,
    Health,
    ServoError,
    Symptom,
    Torque,
    TorqueError,
)
from head_tracking.dynamixel.protocol import ErrorBits
from head_tracking.dynamixel.servo import run
from head_tracking.simulation import SimulatedServo

# Faults


def test_error_that_does_not_shut_down_is_told_once_and_again_after_it_was_gone():
    rig = FakeRig().switched_on()
    rig.pan.error = ErrorBits.INPUT_VOLTAGE
    assert rig.passed(3) == [EventKind.ALARM]
    assert rig.pan_torque is Torque.ON
    rig.pan.error = ErrorBits.ANGLE_LIMIT | ErrorBits.RANGE  # they judge a packet
    assert rig.passed(2) == []
    rig.pan.error = ErrorBits.INPUT_VOLTAGE
    assert rig.passed(2) == [EventKind.ALARM]


def test_recover_does_not_let_a_servo_drive_on_to_its_old_goal():
    rig = FakeRig().switched_on()
    rig.pan.error = ErrorBits.OVERLOAD
    rig.step()
    rig.pan["Torque Limit"], rig.pan["Torque Enable"] = 0, 1
    rig.pan.ignored.add(24)  # Torque Enable
    with pytest.raises(ServoError):
        run(rig.bus.recovering())
    assert rig.pan["Torque Limit"] == 0
    assert rig.pan_torque is Torque.OFF_BY_FAULT


# Heat


def test_hot_joint_rests_until_it_is_no_longer_warm():
    rig = FakeRig().switched_on()
    rig.pan["Present Temperature"] = 67
    assert rig.passed() == []
    rig.pan["Present Temperature"] = 68
    assert rig.passed(3) == [EventKind.RESTING]
    assert rig.pan["Torque Enable"] == 0
    assert rig.pan_torque is Torque.OFF_TO_COOL
    with pytest.raises(GoalError):
        rig.bus.command({"head_pan_joint": Goal(0.1)})
    with pytest.raises(TorqueError):
        run(rig.bus.switching_torque(["head_pan_joint"], True))
    assert rig.pan["Torque Enable"] == 0
    rig.pan["Present Temperature"] = 60
    assert rig.passed() == []
    rig.pan["Present Temperature"] = 59
    assert rig.passed(3) == [EventKind.COOLED]
    assert rig.pan_torque is Torque.OFF_UNTIL_COMMANDED


@pytest.mark.parametrize("missed", [0, 1, 2])
def test_servo_that_was_without_power_for_a_moment_does_not_start_where_it_left_off(missed):
    rig = FakeRig().switched_on(0.5)
    rig.pan.answers = False
    rig.step(2)
    rig.pan.power_off()
    rig.pan.power_on()
    rig.pan.answers = True
    rig.pan.mute += [False, True] * missed
    rig.take_log()
    assert rig.passed(5) == [EventKind.TORQUE_LOST]
    assert rig.pan_torque is Torque.OFF_UNTIL_COMMANDED
    assert {packet[1] for packet in writes(rig.log)} == {TORQUE}
    assert rig.pan["Torque Enable"] == 0


def test_motion_goes_on_after_a_short_silence_in_which_no_goal_is_sent():
    rig = FakeRig().switched_on(0.5)
    rig.pan.answers = False
    rig.step()
    rig.take_log()
    rig.step(2)
    assert writes(rig.log) == []
    rig.pan.answers = True
    assert rig.passed(3) == []
    assert rig.pan_torque is Torque.ON
    assert writes(rig.log)[-1][0] == "sync"


# Commands that stop coming


def test_joint_holds_when_its_commands_stop():
    rig = FakeRig(settings=BusSettings(command_timeout=0.1)).switched_on(0.5)
    rig.pan["Present Position"] = 540
    assert rig.passed(3) == []
    assert rig.passed(4) == [EventKind.HELD]
    assert rig.pan["Goal Position"] == 540
    rig.bus.command({"head_pan_joint": Goal(0.5)})
    rig.step()
    assert rig.pan["Goal Position"] == PAN.ticks(0.5)


def test_joint_that_has_arrived_just_stays():
    rig = FakeRig(settings=BusSettings(command_timeout=0.1)).switched_on(0.5)
    for off in (2, 20):  # also when it is pushed away later
        rig.pan["Present Position"] = PAN.ticks(0.5) - off
        assert rig.passed(20) == []
    assert rig.pan["Goal Position"] == PAN.ticks(0.5)


# Joints stopped, started, changed


def test_stopped_joint_is_relaxed_and_left_alone_while_the_other_goes_on():
    rig = FakeRig().switched_on()
    run(rig.bus.starting(None))  # of a joint that is not stopped
    assert rig.pan_torque is Torque.ON and rig.pan["Torque Enable"] == 1
    run(rig.bus.stopping(["head_pan_joint"]))
    rig.take_log()
    reading = rig.step()
    assert set(reading.states) == {"head_tilt_joint"} and not rig.lost
    assert {request[1] for request in rig.log} == {2}
    assert rig.pan["Torque Enable"] == 0
    assert rig.bus.statistics().servos[0].health is Health.STOPPED
    assert rig.pan_torque is Torque.OFF_STOPPED
    with pytest.raises(GoalError):
        rig.bus.command({"head_pan_joint": Goal(0.1)})
    with pytest.raises(TorqueError):
        run(rig.bus.switching_torque(["head_pan_joint"], True))
    assert rig.pan["Torque Enable"] == 0
    run(rig.bus.stopping(None))  # twice is harmless
    run(rig.bus.switching_torque(None, False))
    assert rig.pan_torque is Torque.OFF_STOPPED


@pytest.mark.parametrize("phase", range(0, 20, 3))  # ms
@pytest.mark.parametrize("request_", ["starting", "recovering"])
def test_a_joint_accepts_a_command_as_soon_as_it_is_started_or_recovered(phase, request_):
    rig = Rig(SimulatedServo(1, "XM430-W350", boot_time=0.1))
    rig.go(0.3)
    if request_ == "starting":
        run(rig.bus.stopping(None))
        done = submit(rig.bus, rig.bus.starting(None))
    else:
        rig.servos[0].overload()
        rig.step(5)
        done = submit(rig.bus, rig.bus.recovering(None, 2.0))
    while not done.done():
        rig.step()
        for _ in range(phase):  # steps between two cycles
            rig.bench.pass_time(0.001)
            rig.bus.cycle.fill(rig.bench.now() + 1_000_000_000)
            if done.done():
                break
    done.result()
    rig.bus.command({"j1": Goal(0.1)})
    assert rig.go(0.1).states["j1"].position == pytest.approx(0.1, abs=0.05)


def test_a_servo_that_has_shut_down_and_does_not_answer_is_not_called_recovered():
    rig = FakeRig().switched_on()
    rig.pan.error = ErrorBits.OVERLOAD
    rig.step()
    rig.pan.answers = False
    rig.step(10)
    with pytest.raises(ServoError):
        run(rig.bus.recovering(None, 0.5), rig.bench.pass_time)


@pytest.mark.parametrize("cycles", [0, 3])
def test_a_joint_that_is_restarting_is_recovered_for_everybody_who_asks(cycles):
    rig = Rig(SimulatedServo(1, "XM430-W350", boot_time=0.3))
    rig.servos[0].overload()
    rig.step(5)
    asked = []
    for _ in range(2):
        asked.append(submit(rig.bus, rig.bus.recovering(None, 2.0)))
        rig.step(cycles)
    rig.step(50)
    assert [each.result(0.0) for each in asked] == [("j1",), ("j1",)]


def test_limits_and_speed_change_while_running_and_the_goal_moves_inside():
    rig = FakeRig().switched_on(0.9)
    rig.bus.joint("head_pan_joint").reconfigure(lowest=450, highest=600, max_speed=0.5)
    assert rig.bus.joint("head_pan_joint").limits == (PAN.position(450), PAN.position(600))
    rig.step()
    assert rig.pan["Goal Position"] == 600
    assert rig.bus.joint("head_pan_joint").configuration.speed_limit == 0.5
    assert rig.pan["Moving Speed"] == speed_ticks(PAN, 0.5)
    with pytest.raises(GoalError):
        rig.bus.command({"head_pan_joint": Goal(0.9)})
    rig.bus.joint("head_pan_joint").reconfigure(max_speed=0.0)
    rig.bus.command({"head_pan_joint": Goal(0.1, 3.0)})
    rig.step()
    assert rig.pan["Moving Speed"] == speed_ticks(PAN, 3.0)


# Memory


def test_eeprom_is_written_only_where_it_differs_and_read_back():
    rig = FakeRig()
    changed = run(
        rig.bus.writing_eeprom(
            "head_tilt_joint",
            EepromSettings(return_delay=0.0, shutdown=("overload", "overheating", "overload")),
        ),
        rig.bench.pass_time,
    )
    assert changed == {
        2: {
            "Return Delay Time": (250, 0),
            "CW Angle Limit": (0, 300),
            "CCW Angle Limit": (1023, 800),
        }
    }
    servo = rig.tilt
    assert (servo["Return Delay Time"], servo["CW Angle Limit"]) == (0, 300)
    assert rig.bus.joint("head_tilt_joint").servos[0].own_range == (300, 800)
    assert run(
        rig.bus.writing_eeprom("head_tilt_joint", EepromSettings()), rig.bench.pass_time
    ) == {2: {}}


@pytest.mark.parametrize("name", ["AX-12", "XL-320", "XM430-W350", "STS3215", "SCS0009"])
def test_a_servo_that_acknowledges_no_writes_is_set_up_and_recovered(name):
    servo = SimulatedServo(1, name, boot_time=0.1)
    servo.set_register("Status Return Level", 1)
    rig = Rig(servo)
    rig.go(0.2)
    run(rig.bus.switching_torque(None, False), rig.bench.pass_time)
    assert rig.torque == [0]
    assert rig.bus.statistics().servos[0].counters.timeouts == 0  # nothing was waited for
    for level in (2, 1):
        settings = EepromSettings(status_return_level=level)
        run(rig.bus.writing_eeprom("j1", settings), rig.bench.pass_time)
    run(rig.bus.switching_torque(None, True), rig.bench.pass_time)
    rig.go(0.2)
    rig.servos[0].overload()
    rig.step(5)
    assert rig.bus.joint("j1").torque is Torque.OFF_BY_FAULT
    recovering = submit(rig.bus, rig.bus.recovering(None, 1.0))
    rig.step(60)
    assert recovering.result(0.0) == ("j1",)
    assert rig.go(-0.2).states["j1"].position == pytest.approx(-0.2, abs=0.05)


def test_what_cannot_be_written_into_the_memory_is_refused(rig):
    def write(joint, settings):
        run(rig.bus.writing_eeprom(joint, settings), rig.bench.pass_time)

    with pytest.raises(ConfigurationError):  # the model has no such error
        write("head_pan_joint", EepromSettings(shutdown=("encoder",)))
    rig.switched_on()
    with pytest.raises(ServoError, match="relax"):
        write("head_pan_joint", EepromSettings())
    rig.tilt["Lock"] = 1
    with pytest.raises(ServoError, match="locked"):
        write("head_tilt_joint", EepromSettings())
    rig.tilt["Lock"] = 0
    rig.tilt.ignored.add(5)  # it does not keep its Return Delay Time
    with pytest.raises(ServoError, match="Return Delay Time"):
        write("head_tilt_joint", EepromSettings())
    assert [servo["Return Delay Time"] for servo in (rig.pan, rig.tilt)] == [250, 250]


def test_limits_that_were_written_before_the_writing_failed_are_known(rig):
    rig.tilt["CW Angle Limit"] = 400
    rig.connect()
    rig.tilt.ignored.add(8)  # CCW Angle Limit
    with pytest.raises(ServoError, match="CCW Angle Limit"):
        run(rig.bus.writing_eeprom("head_tilt_joint", EepromSettings()), rig.bench.pass_time)
    assert rig.passed(5) == [EventKind.RETURNED]
    assert rig.bus.joint("head_tilt_joint").limits == (TILT.position(300), TILT.position(800))


def test_command_is_not_lost_while_the_servo_has_not_been_read():
    rig = FakeRig()
    rig.pan.mute += [True, True]
    rig.step()
    rig.bus.command({"head_pan_joint": Goal(0.1)})
    rig.pan.mute.append(True)
    rig.step()
    assert rig.pan_torque is Torque.OFF_UNTIL_COMMANDED
    rig.step(2)
    assert rig.pan["Goal Position"] == PAN.ticks(0.1)


# What must not run later, or be called something else


def test_a_tripped_watchdog_is_named_and_cleared():
    servo = SimulatedServo(1, "XM430-W350")
    rig = Rig(servo)
    rig.go(0.3)
    servo.set_register("Bus Watchdog", 255)
    servo.set_register("Goal Position", round(servo.true_ticks))
    rig.go(-0.5, 100)
    assert any(Symptom.TRIPPED.value in event.text for event in rig.events)
    assert not any(Symptom.OVERRULED.value in event.text for event in rig.events)
    assert 0 < servo.register("Bus Watchdog") < 255
    assert servo.register("Present Position") == pytest.approx(2048 - 326, abs=10)


def test_a_watchdog_that_tripped_in_an_earlier_run_is_cleared_where_this_run_uses_none():
    servo = SimulatedServo(1, "XM430-W350")
    rig = Rig(servo, settings=BusSettings(watchdog=0.0))
    servo.set_register("Bus Watchdog", 255)
    assert rig.go(0.3).states["j1"].position == pytest.approx(0.3, abs=0.02)
    assert servo.register("Bus Watchdog") == 0


@pytest.mark.parametrize("cycles", [1, 2, 20])
def test_a_servo_that_switches_its_torque_on_when_it_gets_power_is_relaxed_after_a_stop(cycles):
    servo = SimulatedServo(1, "XM430-W350", boot_time=0.02)
    rig = Rig(servo)
    rig.go(0.3)
    servo.set_register("Startup Configuration", 1)  # by another program
    assert rig.bus.relax_at_once(1.0) == {"j1": ""}
    servo.power_off()
    rig.step(cycles)
    servo.power_on()
    assert rig.torque == [1]
    rig.step(10)
    assert rig.torque == [0]


def test_a_command_while_memory_is_written_is_refused_and_not_carried_out_later():
    servo = SimulatedServo(1, "XM430-W350")
    rig = Rig(servo)
    rig.bus.command({"j1": Goal(0.5)})  # of the same cycle
    writing = submit(rig.bus, rig.bus.writing_eeprom("j1", EepromSettings(return_delay=100.0)))
    rig.bench.pass_time(0.02)
    rig.step()
    assert not writing.done()
    with pytest.raises(GoalError):
        rig.bus.command({"j1": Goal(0.5)})
    rig.step(60)
    assert writing.result(0.0)
    assert servo.register("Torque Enable") == 0
    rig.go(0.5)
    assert servo.register("Torque Enable") == 1


@pytest.mark.parametrize("steps", [1, 3, 5, 8])
def test_limits_that_are_narrowed_while_torque_comes_on_hold(steps):
    servo = SimulatedServo(1, "XM430-W350", position=2800.0)
    rig = Rig(servo)
    switching = rig.bus.switching_torque(None, True)
    for _ in range(steps):
        next(switching, None)
    rig.bus.joint("j1").reconfigure(highest=2500)
    run(switching)
    rig.step(5)
    assert servo.register("Torque Enable") == 1
    assert servo.register("Goal Position") <= 2500
