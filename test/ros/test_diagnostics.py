"""What the servo bus says on /diagnostics."""

from dataclasses import replace

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from robot_under_test import wait_for

from head_tracking.dynamixel import BusStatistics, BusTiming, ErrorBits, ServoState, ServoStatistics
from head_tracking.nodes.diagnostics import BusStatus, bus_diagnostics

SERVO = ServoStatistics("pan", 1, 100, 2, 1, 1, 0, False)
STATE = ServoState("pan", 1, 0, 0.5, 0.0, 0.1, 11.9, 35.0, ErrorBits(0), True, 0.5)
TIMING = BusTiming(50.0, 49.9, 0.004, 0)
STATUS = BusStatus("/dev/ttyUSB0", BusStatistics(100, 0, 0, (SERVO,)), TIMING, {"pan": STATE})


def entry(status: BusStatus, name: str) -> DiagnosticStatus:
    return next(s for s in bus_diagnostics(status).status if s.name == f"servo_bus: {name}")


def values(status: DiagnosticStatus) -> dict[str, str]:
    return {value.key: value.value for value in status.values}


def test_a_servo_that_answers_is_ok():
    servo = entry(STATUS, "pan")
    assert servo.level == DiagnosticStatus.OK
    assert servo.message == "torque on"
    assert values(servo)["temperature (degrees Celsius)"] == "35"
    assert values(servo)["timeouts"] == "1"


def test_a_silent_servo_is_never_ok():
    silent = replace(STATUS, states={})
    assert entry(silent, "pan").level == DiagnosticStatus.STALE
    lost = replace(silent, statistics=BusStatistics(9, 0, 0, (replace(SERVO, lost=True),)))
    assert entry(lost, "pan").level == DiagnosticStatus.ERROR
    assert "temperature (degrees Celsius)" not in values(entry(lost, "pan"))


def test_error_bits_are_told_in_words():
    hot = replace(STATUS, states={"pan": replace(STATE, error=ErrorBits.OVERHEATING)})
    assert entry(hot, "pan").level == DiagnosticStatus.ERROR
    assert "overheating" in entry(hot, "pan").message


def test_a_slow_bus_warns():
    slow = replace(STATUS, timing=replace(TIMING, reached_rate=20.0))
    assert entry(slow, "/dev/ttyUSB0").level == DiagnosticStatus.WARN
    assert entry(STATUS, "/dev/ttyUSB0").level == DiagnosticStatus.OK


def test_faults_are_counted():
    assert STATUS.faults == 2


def test_the_running_bus_publishes_them(pointing_robot):
    messages = pointing_robot.listen("/diagnostics", DiagnosticArray)
    wait_for(lambda: messages)
    names = [status.name for status in messages[-1].status]
    assert names[1:] == ["servo_bus: head_pan_joint", "servo_bus: head_tilt_joint"]
    assert {status.level for status in messages[-1].status[1:]} == {DiagnosticStatus.OK}
    assert messages[-1].status[1].message == "relaxed"
