"""What the page makes of the servo bus's real diagnostics."""

from dataclasses import replace

import pytest
from viewing import view
from waiting import wait_for

from head_tracking.dynamixel import BusStatistics, BusTiming, Health, ServoState, ServoStatistics
from head_tracking.dynamixel.protocol import ErrorBits, HardwareErrors
from head_tracking.page.robot import SilenceWatch
from head_tracking.page.status import advice, faults
from head_tracking.ros.bus.bus_status import BusStatus, bus_diagnostics
from head_tracking.ros.kit.diagnostics import FAULT, FaultName, Level, health_from_message
from head_tracking.ros.kit.diagnostics import Health as PageHealth

SERVO = ServoStatistics(
    "pan", 1, 100, 2, 1, 1, "AX-12", 24, last_stamp=1_000_000_000,
    temperature=35.0, voltage=11.9, load=0.1, torque="torque on",
)  # fmt: skip
STATE = ServoState("pan", 1, 0, 0.5, 0.0, 0.1, 11.9, 35.0, ErrorBits(0), True, 0.5)
STATUS = BusStatus(
    "/dev/ttyUSB0",
    BusStatistics(100, 0, 0, (SERVO,)),
    BusTiming(50.0, 49.9, 0.004, 0),
    {"pan": STATE},
    1_010_000_000,
)


def servo(**changes: object) -> PageHealth:
    statistics = replace(STATUS.statistics, servos=(replace(SERVO, **changes),))
    return health_from_message(bus_diagnostics(replace(STATUS, statistics=statistics))[1])


def test_there_is_a_value_for_every_gauge_of_the_page():
    values = servo().values
    for name, value in (("temperature", 35.0), ("voltage", 11.9), ("load", 0.1)):
        (text,) = (text for key, text in values.items() if key.startswith(name))
        assert float(text) == pytest.approx(value)


@pytest.mark.parametrize(
    "changes",
    [
        {"health": Health.UNKNOWN},
        {"health": Health.LOST},
        *({"health": Health.FAULTED, "errors": bit} for bit in HardwareErrors),
        {"errors": ErrorBits.OVERLOAD},
        {"temperature": 75.0},
    ],
)
def test_there_is_advice_for_everything_that_can_be_wrong_with_a_servo(changes):
    wrong = servo(**changes)
    assert wrong.level >= Level.ERROR
    assert advice(wrong.values[FAULT], "servo_bus") != advice("none", "servo_bus")


def test_a_servo_that_has_missed_a_cycle_is_no_trouble_yet():
    stale = servo(health=Health.STALE)
    assert stale.level is Level.STALE
    assert not faults([stale])
    silent = replace(stale, values={FAULT: FaultName.SILENT})
    assert faults([silent])


def test_there_is_advice_for_a_port_that_has_gone():
    statistics = replace(STATUS.statistics, connected=False)
    port = health_from_message(bus_diagnostics(replace(STATUS, statistics=statistics))[0])
    assert port.level is Level.ERROR
    assert advice(port.values[FAULT], "servo_bus") != advice("none", "servo_bus")


def test_joints_fall_silent_and_speak_again():
    now = 0.0
    watch = SilenceWatch(2.0, lambda: now)
    assert watch.silent({"pan": 5, "tilt": None}) == ()
    now = 1.9
    assert watch.silent({"pan": 6, "tilt": None}) == ()
    now = 2.1
    assert watch.silent({"pan": 6, "tilt": None}) == ("tilt",)
    assert watch.silent({"pan": 6, "tilt": 7}) == ()
    now = 5.0
    assert watch.silent({"pan": 6, "tilt": 8}) == ("pan",)
    assert watch.silent({}) == ()
    assert watch.silent({"pan": 6}) == ()


def test_servos_are_relaxed_until_the_first_command_and_say_when_they_refuse(make_robot):
    relaxed = make_robot("--mode", "point", "--viewer")
    seen = view(relaxed.threads, relaxed.composition.buffer).robot

    def torques() -> list[tuple[bool | None, bool]]:
        return [(servo.torque, servo.refuses) for servo in seen.joints.servos()]

    wait_for(lambda: torques() == [(False, False)] * 2, 30.0)
    assert seen.joints.set_torque("", False).done
    wait_for(lambda: torques() == [(False, True)] * 2)
    assert seen.joints.set_torque("", True).done
    wait_for(lambda: torques() == [(True, False)] * 2)
