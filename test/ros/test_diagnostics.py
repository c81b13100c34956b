"""What the servo bus says on /diagnostics, and what the page makes of it."""

from dataclasses import replace
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from head_tracking.dynamixel import (
    Adapter,
    BusSettings,
    BusStatistics,
    BusTiming,
    Health,
    ServoStatistics,
    Symptom,
)
from head_tracking.dynamixel.protocol import ErrorBits, HardwareErrors
from head_tracking.dynamixel.state import Counters
from head_tracking.page.status import advice, faults
from head_tracking.ros.bus.bus_status import bus_diagnostics
from head_tracking.ros.kit.diagnostics import FAULT, FaultName, Level, Part, health_from_message

SERVO = ServoStatistics(
    "pan",
    1,
    Counters(100, 2, 1, 1),
    model="AX-12",
    firmware_version=24,
    last_stamp=1_000_000_000,
    temperature=35.0,
    voltage=11.9,
    load=0.1,
    torque="torque on",
)
WARM = {Symptom.WARM: "it is at 64 °C"}
TIMING = BusTiming(50.0, 49.9, 0.004, 0)
BUS = BusStatistics(100, 0, 0, (SERVO,), port_name="/dev/ttyUSB0")
NOW = 1_010_000_000


def with_servo(**changes: Any) -> BusStatistics:
    return replace(BUS, servos=(replace(SERVO, **changes),))


def entry(bus: BusStatistics, name: str, timing: BusTiming = TIMING) -> DiagnosticStatus:
    entries = bus_diagnostics(bus, timing, BusSettings(), NOW)
    return next(each for each in entries if each.name == f"servo_bus: {name}")


def values(status: DiagnosticStatus) -> dict[str, str]:
    return {value.key: value.value for value in status.values}


def test_a_servo_that_answers_is_ok():
    servo = entry(BUS, "pan")
    assert servo.level == DiagnosticStatus.OK
    assert servo.message == "torque on"
    told = values(servo)
    assert told["model"] == "AX-12"
    assert told["state"] == "present"
    assert told["temperature (degrees Celsius)"] == "35"
    assert told["voltage (V)"] == "11.9"
    assert told["load (share of full torque)"] == "0.10"
    assert told["errors"] == "none"
    assert told["age (s)"] == "0.010"
    counts = [told[name] for name in ("replies", "retries", "timeouts", "corrupt replies")]
    assert counts == ["100", "2", "1", "1"]


@pytest.mark.parametrize(
    ("changes", "level"),
    [
        ({"health": Health.LOST}, DiagnosticStatus.ERROR),
        ({"health": Health.STALE}, DiagnosticStatus.STALE),
        ({"health": Health.STOPPED}, DiagnosticStatus.WARN),
        ({"last_stamp": 500_000_000}, DiagnosticStatus.STALE),
        ({"errors": ErrorBits.INPUT_VOLTAGE}, DiagnosticStatus.ERROR),
        ({"temperature": 64.0}, DiagnosticStatus.OK),
        ({"temperature": 64.0, "symptoms": WARM}, DiagnosticStatus.WARN),
        ({"temperature": 65.0, "symptoms": WARM}, DiagnosticStatus.ERROR),
    ],
)
def test_only_a_healthy_servo_with_fresh_data_is_ok(changes, level):
    assert entry(with_servo(**changes), "pan").level == level


def test_two_servos_of_a_joint_have_an_entry_each():
    both = replace(BUS, servos=(SERVO, replace(SERVO, id=7, symptoms=WARM)))
    assert entry(both, "pan (servo 1)").level == DiagnosticStatus.OK
    assert entry(both, "pan (servo 7)").level == DiagnosticStatus.WARN


def test_a_slow_bus_warns():
    slow = replace(TIMING, reached_rate=20.0)
    assert entry(BUS, "/dev/ttyUSB0", slow).level == DiagnosticStatus.WARN
    assert entry(BUS, "/dev/ttyUSB0").level == DiagnosticStatus.OK


def test_a_port_that_has_gone_and_a_slow_adapter_are_told():
    gone = replace(BUS, connected=False)
    assert entry(gone, "/dev/ttyUSB0").level == DiagnosticStatus.ERROR
    adapter = Adapter("ftdi_sio", 0.016, "set the timer to 1 ms")
    slow = entry(replace(BUS, adapter=adapter), "/dev/ttyUSB0")
    assert slow.level == DiagnosticStatus.WARN
    assert slow.message == "set the timer to 1 ms"
    assert values(slow)["adapter"] == "ftdi_sio, latency timer 16 ms"


# the page


def servo(**changes: Any) -> Part:
    return health_from_message(entry(with_servo(**changes), "pan"))


@pytest.mark.parametrize(
    "changes",
    [
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
