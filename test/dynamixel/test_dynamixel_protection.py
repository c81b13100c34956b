"""Faults, heat, watchdogs, timeouts; joints stopped, started and changed while running."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from dynamixel_fakes import (
    PAN,
    TILT,
    TORQUE,
    FakeClock,
    FakePort,
    FakeServo,
    speed_ticks,
    submit,
    writes,
)
from simulated_device import Bench, joint_of

from head_tracking.dynamixel import (
    BusEvent,
    BusReading,
    BusSettings,
    ConfigurationError,
    EepromSettings,
    EventKind,
    Goal,
    GoalError,
    Health,
    JointConfiguration,
    ReplyTimeoutError,
    ServoBus,
    ServoCalibration,
    ServoError,
    Symptom,
    Torque,
    TorqueError,
    servo_model,
)
from head_tracking.dynamixel.protocol import ErrorBits, HardwareErrors
from head_tracking.dynamixel.servo import run
from head_tracking.parameters import ParameterError
from head_tracking.simulation import SimulatedServo

XM = servo_model("XM430-W350")
XM_PAN = JointConfiguration(
    "head_pan_joint", 1, 2048, 1024, 3072, controller="head_pan_controller", model=XM
)


class Rig:
    """A connected bus with a fake port and passed-in time."""

    def __init__(
        self,
        *joints: JointConfiguration,
        port: FakePort | None = None,
        settings: BusSettings | None = None,
    ) -> None:
        self.port = port or FakePort()
        self.clock = FakeClock()
        self.bus = ServoBus(
            self.port,
            joints or (PAN, TILT),
            self.clock,
            monotonic=self.clock,
            settings=settings,
        )
        self.bus.connect()
        self.port.take_log()

    def steps(self, count: int = 1, period: float = 0.02) -> list[BusReading]:
        readings = []
        for _ in range(count):
            self.clock.pass_time(period)
            readings.append(self.bus.step())
        return readings

    def events(self, count: int = 1) -> list[EventKind]:
        """What is told; a fake servo never moves, which is no matter here."""
        events = [event for reading in self.steps(count) for event in reading.events]
        return [event.kind for event in events if event.kind is not EventKind.SYMPTOM]

    def switched_on(self, position: float = 0.2) -> Rig:
        self.bus.command({"head_pan_joint": Goal(position)})
        self.steps()
        self.port.take_log()
        return self

    @property
    def pan(self) -> FakeServo:
        return self.port.servos[1]

    @property
    def torque(self) -> Torque:
        return self.bus.joint("head_pan_joint").torque


def xm_rig(**options: BusSettings) -> Rig:
    return Rig(XM_PAN, port=FakePort(1, model=XM), **options)


# Faults


@pytest.mark.parametrize("error", [ErrorBits.OVERLOAD, ErrorBits.OVERHEATING])
def test_servo_that_shuts_down_is_relaxed_and_reported_once(error: ErrorBits) -> None:
    rig = Rig().switched_on()
    rig.pan.error = error
    assert rig.events(3) == [EventKind.FAULTED]
    assert rig.torque is Torque.OFF_BY_FAULT
    assert rig.pan["Torque Enable"] == 0
    assert rig.bus.statistics().servos[0].health is Health.FAULTED
    with pytest.raises(GoalError, match="call recover"):
        rig.bus.command({"head_pan_joint": Goal(0.1)})
    with pytest.raises(TorqueError, match="shut down"):
        run(rig.bus.switching_torque(["head_pan_joint"], True))
    rig.bus.command({"head_tilt_joint": Goal(0.1)})  # the other goes on


def test_error_that_does_not_shut_down_is_told_once_and_again_after_it_was_gone() -> None:
    rig = Rig().switched_on()
    rig.pan.error = ErrorBits.INPUT_VOLTAGE
    assert rig.events(3) == [EventKind.ALARM]
    assert rig.torque is Torque.ON
    rig.pan.error = 0
    assert rig.events(2) == []
    rig.pan.error = ErrorBits.INPUT_VOLTAGE
    assert rig.events(2) == [EventKind.ALARM]


def test_error_bits_that_judge_a_packet_are_no_alarm() -> None:
    rig = Rig().switched_on()
    rig.pan.error = ErrorBits.ANGLE_LIMIT | ErrorBits.RANGE
    assert rig.events(3) == []


def test_fault_that_is_still_there_after_recover_is_told_again() -> None:
    rig = Rig().switched_on()
    rig.pan.error = ErrorBits.OVERHEATING
    rig.steps()
    run(rig.bus.recovering())
    assert rig.events(2) == [EventKind.RECOVERED, EventKind.FAULTED]
    assert rig.torque is Torque.OFF_BY_FAULT


def test_recover_that_fails_says_so() -> None:
    rig = Rig().switched_on()
    rig.pan.error = ErrorBits.OVERLOAD
    rig.steps()
    rig.pan["Torque Limit"] = 0
    rig.pan.ignored.add(34)
    with pytest.raises(ServoError, match="Torque Limit"):
        run(rig.bus.recovering())
    assert rig.torque is Torque.OFF_BY_FAULT


def test_recover_does_not_let_a_servo_drive_on_to_its_old_goal() -> None:
    rig = Rig().switched_on()
    rig.pan.error = ErrorBits.OVERLOAD
    rig.steps()
    rig.pan["Torque Limit"], rig.pan["Torque Enable"] = 0, 1
    rig.pan.ignored.add(24)  # Torque Enable
    with pytest.raises(ServoError):
        run(rig.bus.recovering())
    assert rig.pan["Torque Limit"] == 0
    assert rig.torque is Torque.OFF_BY_FAULT


def test_error_register_is_read_once_a_second_only() -> None:
    rig = xm_rig().switched_on()
    rig.pan.error = 0x80
    rig.pan["Hardware Error Status"] = int(HardwareErrors.INPUT_VOLTAGE)
    rig.steps(100)
    looks = [packet for packet in rig.port.log if packet[:3] == ("read", 1, 70)]
    assert 2 <= len(looks) <= 3


# Heat


def test_hot_joint_rests_until_it_is_no_longer_warm() -> None:
    rig = Rig().switched_on()
    rig.pan["Present Temperature"] = 67
    assert rig.events() == []
    rig.pan["Present Temperature"] = 68
    assert rig.events(3) == [EventKind.RESTING]
    assert rig.pan["Torque Enable"] == 0
    assert rig.torque is Torque.OFF_TO_COOL
    with pytest.raises(GoalError):
        rig.bus.command({"head_pan_joint": Goal(0.1)})
    with pytest.raises(TorqueError):
        run(rig.bus.switching_torque(["head_pan_joint"], True))
    assert rig.pan["Torque Enable"] == 0
    rig.pan["Present Temperature"] = 60
    assert rig.events() == []
    rig.pan["Present Temperature"] = 59
    assert rig.events(3) == [EventKind.COOLED]
    assert rig.torque is Torque.OFF_UNTIL_COMMANDED


@pytest.mark.parametrize("missed", [0, 1, 2])
def test_servo_that_was_without_power_for_a_moment_does_not_start_where_it_left_off(
    missed: int,
) -> None:
    rig = Rig().switched_on(0.5)
    rig.pan.answers = False
    rig.steps(2)
    rig.port.servos[1] = FakeServo(1)
    rig.port.failures[1] += [None, ReplyTimeoutError("no answer about its torque")] * missed
    rig.port.take_log()
    assert rig.events(5) == [EventKind.TORQUE_LOST]
    assert rig.torque is Torque.OFF_UNTIL_COMMANDED
    assert {packet[1] for packet in writes(rig.port.log)} == {TORQUE}
    assert rig.pan["Torque Enable"] == 0


def test_motion_goes_on_after_a_short_silence_in_which_no_goal_is_sent() -> None:
    rig = Rig().switched_on(0.5)
    rig.pan.answers = False
    rig.steps()
    rig.port.take_log()
    rig.steps(2)
    assert writes(rig.port.log) == []
    rig.pan.answers = True
    assert rig.events(3) == []
    assert rig.torque is Torque.ON
    assert writes(rig.port.log)[-1][0] == "sync"


# Watchdog


def test_servos_that_may_have_stopped_by_themselves_are_held_where_they_are() -> None:
    rig = xm_rig(settings=BusSettings(watchdog=0.5)).switched_on(0.5)
    rig.pan["Present Position"] = 2100
    (reading,) = rig.steps(period=0.6)
    assert [event.kind for event in reading.events] == [EventKind.HELD]
    assert rig.pan["Goal Position"] == 2100
    assert rig.events(3) == []


# Commands that stop coming


def test_joint_holds_when_its_commands_stop() -> None:
    rig = Rig(settings=BusSettings(command_timeout=0.1)).switched_on(0.5)
    rig.pan["Present Position"] = 540
    assert rig.events(3) == []
    assert rig.events(4) == [EventKind.HELD]
    assert rig.pan["Goal Position"] == 540
    rig.bus.command({"head_pan_joint": Goal(0.5)})
    rig.steps()
    assert rig.pan["Goal Position"] == PAN.ticks(0.5)


def test_joint_that_has_arrived_just_stays() -> None:
    rig = Rig(settings=BusSettings(command_timeout=0.1)).switched_on(0.5)
    for off in (2, 20):  # also when it is pushed away later
        rig.pan["Present Position"] = PAN.ticks(0.5) - off
        assert rig.events(20) == []
    assert rig.pan["Goal Position"] == PAN.ticks(0.5)


# Joints stopped, started, changed


def test_stopped_joint_is_relaxed_and_left_alone_while_the_other_goes_on() -> None:
    rig = Rig().switched_on()
    run(rig.bus.starting(None))  # of a joint that is not stopped
    assert rig.torque is Torque.ON and rig.pan["Torque Enable"] == 1
    run(rig.bus.stopping(["head_pan_joint"]))
    rig.port.take_log()
    (reading,) = rig.steps()
    assert set(reading.states) == {"head_tilt_joint"} and not reading.lost
    assert rig.port.log == [("read", 2, 36, 8)]
    assert rig.pan["Torque Enable"] == 0
    assert rig.bus.statistics().servos[0].health is Health.STOPPED
    assert rig.torque is Torque.OFF_STOPPED
    with pytest.raises(GoalError):
        rig.bus.command({"head_pan_joint": Goal(0.1)})
    with pytest.raises(TorqueError):
        run(rig.bus.switching_torque(["head_pan_joint"], True))
    assert rig.pan["Torque Enable"] == 0
    run(rig.bus.stopping(None))  # twice is harmless
    run(rig.bus.switching_torque(None, False))
    assert rig.torque is Torque.OFF_STOPPED


def test_joint_whose_servo_is_missing_at_the_start_is_looked_for() -> None:
    rig = Rig()
    run(rig.bus.stopping(["head_pan_joint"]))
    rig.pan.answers = False
    with pytest.raises(ServoError, match="did not answer"):
        run(rig.bus.starting(["head_pan_joint"]))
    rig.pan.answers = True
    rig.steps(5)
    assert "head_pan_joint" in rig.steps()[0].states


def test_joint_whose_servo_cannot_be_used_at_the_start_stays_out_of_the_cycle() -> None:
    rig = Rig()
    run(rig.bus.stopping(["head_pan_joint"]))
    rig.pan["CCW Angle Limit"] = 0  # wheel mode
    with pytest.raises(ServoError):
        run(rig.bus.starting(["head_pan_joint"]))
    assert "head_pan_joint" not in rig.steps(5)[-1].states
    rig.pan["CCW Angle Limit"] = 1023
    assert "head_pan_joint" in rig.steps(5)[-1].states


def test_a_servo_that_has_shut_down_and_does_not_answer_is_not_called_recovered() -> None:
    rig = Rig().switched_on()
    rig.pan.error = ErrorBits.OVERLOAD
    rig.steps()
    rig.pan.answers = False
    rig.steps(10)
    with pytest.raises(ServoError):
        run(rig.bus.recovering())


def test_limits_and_speed_change_while_running_and_the_goal_moves_inside() -> None:
    rig = Rig().switched_on(0.9)
    rig.bus.joint("head_pan_joint").reconfigure(lowest=450, highest=600, max_speed=0.5)
    assert rig.bus.joint("head_pan_joint").limits == (PAN.position(450), PAN.position(600))
    rig.steps()
    assert rig.pan["Goal Position"] == 600
    assert rig.bus.joint("head_pan_joint").configuration.speed_limit == 0.5
    assert rig.pan["Moving Speed"] == speed_ticks(PAN, 0.5)
    with pytest.raises(GoalError):
        rig.bus.command({"head_pan_joint": Goal(0.9)})
    rig.bus.joint("head_pan_joint").reconfigure(max_speed=0.0)
    rig.bus.command({"head_pan_joint": Goal(0.1, 3.0)})
    rig.steps()
    assert rig.pan["Moving Speed"] == speed_ticks(PAN, 3.0)


# Two servos on a joint


def test_a_joint_rests_when_its_second_servo_is_hot() -> None:
    second = ServoCalibration("head_pan_joint", 2, 512, 1023, 0)
    rig = Rig(replace(PAN, second=second)).switched_on(0.0)
    rig.port.servos[2]["Present Temperature"] = 70
    rig.steps(2)
    assert rig.torque is Torque.OFF_TO_COOL


def test_two_servos_of_a_joint_move_together_and_hold_together() -> None:
    second = ServoCalibration("head_pan_joint", 2, 512, 1023, 0)
    rig = Rig(replace(PAN, second=second))
    rig.port.servos[2]["Present Load"] = 1024 + 200
    rig.pan["Present Load"] = 100
    rig.bus.command({"head_pan_joint": Goal(0.3)})
    rig.steps(2)
    loads = [servo.load for servo in rig.bus.servos]
    assert loads == pytest.approx([100 / 1023, 200 / 1023])  # turned with the position
    goals = (rig.pan["Goal Position"], rig.port.servos[2]["Goal Position"])
    assert goals == (PAN.ticks(0.3), second.ticks(0.3)) and sum(goals) == 1024
    rig.port.servos[2].error = ErrorBits.OVERLOAD
    assert rig.events() == [EventKind.TORQUE_ON] or rig.torque is Torque.OFF_BY_FAULT
    assert [servo["Torque Enable"] for servo in rig.port.servos.values()] == [0, 0]


# Memory


def pauses() -> list[float]:
    return []


def test_eeprom_is_written_only_where_it_differs_and_read_back() -> None:
    rig = Rig()
    waited = pauses()
    changed = run(
        rig.bus.writing_eeprom(
            "head_tilt_joint",
            EepromSettings(return_delay=0.0, shutdown=("overload", "overheating")),
        ),
        waited.append,
    )
    assert changed == {
        2: {
            "Return Delay Time": (250, 0),
            "CW Angle Limit": (0, 300),
            "CCW Angle Limit": (1023, 800),
        }
    }
    servo = rig.port.servos[2]
    assert (servo["Return Delay Time"], servo["CW Angle Limit"]) == (0, 300)
    assert rig.bus.joint("head_tilt_joint").servos[0].own_range == (300, 800)
    assert len(waited) == 3 and min(waited) >= 0.01
    assert run(rig.bus.writing_eeprom("head_tilt_joint", EepromSettings()), waited.append) == {
        2: {}
    }


def test_eeprom_is_not_written_while_torque_is_on_or_the_memory_is_locked() -> None:
    rig = Rig().switched_on()
    with pytest.raises(ServoError, match="relax it first"):
        run(rig.bus.writing_eeprom("head_pan_joint", EepromSettings()), pauses().append)
    rig.port.servos[2]["Lock"] = 1
    with pytest.raises(ServoError, match="locked"):
        run(rig.bus.writing_eeprom("head_tilt_joint", EepromSettings()), pauses().append)
    assert all(servo["Return Delay Time"] == 250 for servo in rig.port.servos.values())


def test_an_error_that_the_model_does_not_have_is_refused_before_anything_is_written() -> None:
    rig, settings = Rig(), EepromSettings(shutdown=("encoder",))
    with pytest.raises(ConfigurationError):
        run(rig.bus.writing_eeprom("head_pan_joint", settings), pauses().append)
    assert writes(rig.port.log) == []


@pytest.mark.parametrize(
    "option",
    [
        *({"return_delay": delay} for delay in (math.nan, math.inf, -1.0, 600.0, "fast")),
        *({"status_return_level": level} for level in (0, 3, 1.5)),
        {"shutdown": "overload"},
    ],
)
def test_impossible_settings_of_the_memory_are_refused(option: dict[str, Any]) -> None:
    with pytest.raises(ParameterError):
        EepromSettings(**option)


def test_servo_that_does_not_keep_a_setting_is_named() -> None:
    rig = Rig()
    rig.pan.ignored.add(5)
    with pytest.raises(ServoError, match="servo 1 keeps 250 in Return Delay Time instead of 0"):
        run(rig.bus.writing_eeprom("head_pan_joint", EepromSettings()), pauses().append)


def test_command_is_not_lost_while_the_servo_has_not_been_read() -> None:
    rig = Rig()
    rig.port.failures[1].extend([ReplyTimeoutError("late")] * 2)
    rig.steps()
    rig.bus.command({"head_pan_joint": Goal(0.1)})
    rig.port.failures[1].append(ReplyTimeoutError("late"))
    rig.steps()
    assert rig.torque is Torque.OFF_UNTIL_COMMANDED
    rig.steps(2)
    assert rig.pan["Goal Position"] == PAN.ticks(0.1)


# What must not run later, or be called something else


def simulated(position: float = 2048.0) -> tuple[SimulatedServo, Bench, ServoBus]:
    servo = SimulatedServo(1, XM, position=position)
    bench = Bench([servo])
    bus = bench.servo_bus([joint_of(1, XM)])
    bus.connect()
    return servo, bench, bus


def cycles(bench: Bench, bus: ServoBus, count: int) -> list[BusEvent]:
    events: list[BusEvent] = []
    for _ in range(count):
        bench.pass_time(0.02)
        events += bus.step().events
    return events


def test_a_tripped_watchdog_is_named_and_cleared() -> None:
    servo, bench, bus = simulated()
    bus.command({"j1": Goal(0.3)})
    cycles(bench, bus, 80)
    servo.set_register("Bus Watchdog", 255)
    servo.set_register("Goal Position", round(servo.true_ticks))
    bus.command({"j1": Goal(-0.5)})
    events = cycles(bench, bus, 100)
    assert any(Symptom.TRIPPED.value in event.text for event in events)
    assert not any(Symptom.OVERRULED.value in event.text for event in events)
    assert 0 < servo.register("Bus Watchdog") < 255
    bus.command({"j1": Goal(-0.5)})
    cycles(bench, bus, 80)
    assert servo.register("Present Position") == pytest.approx(2048 - 326, abs=10)


def test_a_command_while_memory_is_written_is_refused_and_not_carried_out_later() -> None:
    servo, bench, bus = simulated()
    bus.command({"j1": Goal(0.5)})  # of the same cycle
    writing = submit(bus, bus.writing_eeprom("j1", EepromSettings(return_delay=100.0)))
    cycles(bench, bus, 1)
    assert not writing.done()
    with pytest.raises(GoalError):
        bus.command({"j1": Goal(0.5)})
    cycles(bench, bus, 60)
    assert writing.result(0.0)
    assert servo.register("Torque Enable") == 0
    bus.command({"j1": Goal(0.5)})
    cycles(bench, bus, 60)
    assert servo.register("Torque Enable") == 1


@pytest.mark.parametrize("steps", range(1, 9))
def test_limits_that_are_narrowed_while_torque_comes_on_hold(steps: int) -> None:
    servo, bench, bus = simulated(position=2800.0)
    switching = bus.switching_torque(None, True)
    for _ in range(steps):
        next(switching, None)
    bus.joint("j1").reconfigure(highest=2500)
    run(switching)
    cycles(bench, bus, 5)
    assert servo.register("Torque Enable") == 1
    assert servo.register("Goal Position") <= 2500
