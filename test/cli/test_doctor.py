"""doctor: a red case for each check, and what doctor must not do."""

import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random

import pytest
from simulated_device import Bench, as_device

from head_tracking.cli.doctor import __main__ as doctor
from head_tracking.cli.doctor import configured, network
from head_tracking.cli.doctor.findings import Finding, Grade, show
from head_tracking.cli.doctor.network import Traffic, check_clocks
from head_tracking.dynamixel import Adapter, PortBusyError, servo_model
from head_tracking.dynamixel.exceptions import PortMissingError, PortPermissionError
from head_tracking.simulation import Fault, Faults, SimulatedBus, SimulatedLine, SimulatedServo

XM = servo_model("XM430-W350")


def head_of(model: str, more: str = "") -> str:
    """Return the parameters of a head of two servos; `more` of the first one."""
    return f"""
/**/servo_bus:
  ros__parameters:
    head_pan_controller:
      motor: {{model: {model}, id: 1, init: 2048, min: 1024, max: 3072{more}}}
    head_tilt_controller:
      motor: {{model: {model}, id: 2, init: 2048, min: 1500, max: 2600}}
"""


class Head(Bench):
    """Two simulated servos on a port, and doctor."""

    def __init__(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        super().__init__([SimulatedServo(1), SimulatedServo(2)], reply_timeout=0.03)
        self.tmp_path, self._monkeypatch = tmp_path, monkeypatch
        self.found: list[Finding] = []
        self.adapter = Adapter("ftdi_sio", 0.001)
        self.latency = 0.0  # s
        self.opening: Callable[[], object] = lambda: None
        self.arguments = ["--listen", "0"]
        self.baud_rate = 0  # of the servos; 0: any
        self.sent: list[bytes] = []

    def servos(self, *servos: SimulatedServo, faults: Faults | None = None) -> None:
        self.bus = SimulatedBus(servos, faults=faults)

    def params(self, text: str) -> None:
        file = self.tmp_path / "params.yaml"
        file.write_text(text)
        self.arguments += ["--params", str(file)]

    def open_device(self, name: str, baud_rate: int) -> SimulatedLine:
        self.opening()
        line = SimulatedLine(self.bus, self.clock, baud_rate, latency=self.latency)
        device, write = as_device(line), line.write
        device.adapter = self.adapter

        def note(data: bytes) -> None:
            self.sent.append(data)
            if self.baud_rate in (0, baud_rate):
                write(data)

        device.write = note
        return device

    def check(self) -> int:
        def note(finding: Finding) -> None:
            self.found.append(finding)
            show(finding)

        self.found.clear()
        self._monkeypatch.setattr(doctor, "show", note)
        return doctor.main(self.arguments, self.make_port)

    @property
    def levels(self) -> dict[str, Grade]:
        """The highest level of each check."""
        checks = {finding.check for finding in self.found}
        return {name: max(f.level for f in self.found if f.check == name) for name in checks}


read_once = cache(configured.load_robot_model)


@pytest.fixture
def head(tmp_path, monkeypatch):
    monkeypatch.setattr(configured, "load_robot_model", read_once)
    return Head(tmp_path, monkeypatch)


def _raise(error: Exception) -> None:
    raise error


def _opening(error: Exception) -> Callable[[Head], None]:
    return lambda head: setattr(head, "opening", lambda: _raise(error))


def _register(name: str, value: int) -> Callable[[Head], None]:
    return lambda head: head[1].set_register(name, value)


def _slow_adapter(head: Head) -> None:
    head.latency = 0.016
    head.adapter = Adapter("ftdi_sio", 0.016, "its latency timer is 16 ms")


def _spoilt(head: Head) -> None:
    head.params(head_of("XM430-W350"))
    head.servos(SimulatedServo(1, XM, firmware=255), SimulatedServo(2, XM))


def _shadowing(head: Head) -> None:
    head.params(head_of("XM430-W350"))
    head.servos(SimulatedServo(1, XM), SimulatedServo(2, XM))
    head[1].set_register("Secondary ID", 2)


def _contrary(head: Head) -> None:
    pair = "      second_motor: {id: 3, init: 2048, min: 2600, max: 1500}\n"
    head.params(head_of("XM430-W350") + pair)
    head.servos(*[SimulatedServo(each, XM) for each in (1, 2, 3)])
    for each in (2, 3):  # face to face: the one must stay below zero, the other above
        head[each].set_register("Max Position Limit", 1900)


def _disturbed(head: Head) -> None:
    faults = Faults(Random(1), 0.0, [Fault.CORRUPT])
    head.servos(SimulatedServo(1), SimulatedServo(2), faults=faults)
    head.opening = lambda: setattr(faults, "rate", 0.3)


def _swapped(head: Head) -> None:
    head.params(
        "servo_bus: {ros__parameters: {head_pan_controller: {motor: {min: 100, max: 900}}}}"
    )
    for servo, limits in ((head[1], (300, 800)), (head[2], (100, 900))):
        servo.set_register("CW Angle Limit", limits[0])
        servo.set_register("CCW Angle Limit", limits[1])


def _of_first(name: str, value: float) -> Callable[[Head], None]:
    return lambda head: setattr(head[1], name, value)


CONFIGURED = "servo_bus: {ros__parameters: "
APART = "head_tracker: {ros__parameters: {min_pan: 1.0}}\n"
WIDE = "{head_tilt_controller: {motor: {min: 0, max: 1023}}}}"
RED: list[tuple[str, Callable[[Head], None]]] = [
    ("configuration", lambda h: h.params(CONFIGURED + "{head_pan_controller.motor.id: x}}")),
    ("configuration", lambda h: h.params(CONFIGURED + "{head_tilt_controller.baud_rate: 57600}}")),
    ("configuration", lambda h: h.params("- 1")),
    ("configuration", lambda h: h.params("servobus: {ros__parameters: {baud_rate: 57600}}")),
    ("configuration", lambda h: h.params("{")),
    ("configuration", lambda h: h.arguments.extend(["--params", "/nowhere.yaml"])),
    ("model", lambda head: head.arguments.extend(["--robot", "nobody"])),
    ("model", lambda h: h.params(CONFIGURED + "{head_pan_controller.joint_name: nose}}")),
    ("model", lambda h: h.params("head_tracker: {ros__parameters: {camera_link: nose}}")),
    ("model", lambda h: h.params("head_tracker: {ros__parameters: {law: predictve}}")),
    ("model", lambda h: h.params("point_head: {ros__parameters: {max_joint_sped: 1.0}}")),
    ("model", lambda h: h.params(APART + CONFIGURED + "{head_pan_controller.motor.max: 600}}")),
    ("port", _opening(PortMissingError("/dev/ttyUSB0", ()))),
    ("port", _opening(PortPermissionError("/dev/ttyUSB0", "dialout"))),
    ("port", lambda head: head.arguments.extend(["--baud", "12345"])),
    ("servo 1", lambda h: h.servos(SimulatedServo(1, servo_model("AX-18")), SimulatedServo(2))),
    (
        "servo 1",
        lambda h: h.servos(SimulatedServo(1), SimulatedServo(1, position=100), SimulatedServo(2)),
    ),
    ("servo 1", _register("CCW Angle Limit", 0)),
    ("servo 1", _register("Status Return Level", 0)),
    ("servo 1", _spoilt),
    ("servo 1", _of_first("supply_voltage", 5.5)),
    ("servo 1", _of_first("temperature", 66.0)),
    ("servo 1", lambda head: head[1].overload()),
    ("servo 1", _swapped),
    ("servo 1", _shadowing),
    ("servo 2", _contrary),
    ("adapter", _slow_adapter),
    ("line", _disturbed),
]


@pytest.mark.parametrize(("check", "spoil"), RED)
def test_each_check_can_be_red(check, spoil, head):
    spoil(head)
    assert head.check() == 2
    assert head.levels.get(check) is Grade.RED


def test_a_correct_head_is_green(head):
    assert head.check() == 0
    assert {check for check, _ in RED} < head.levels.keys()
    assert {check for check, level in head.levels.items() if level is not Grade.GREEN} == {
        "network"
    }


def test_a_supply_below_what_the_servo_itself_demands_is_shown_with_that_limit(head):
    head[1].set_register("Min Voltage Limit", 130)
    assert head.check() == 2
    assert ["13.0 V" in each.text for each in head.found if each.check == "servo 1"] == [True]


@pytest.mark.parametrize(
    ("check", "spoil"),
    [
        ("servo 1", _of_first("supply_voltage", 10.0)),
        ("servo 1", _of_first("temperature", 62.0)),
        ("adapter", lambda head: setattr(head, "adapter", Adapter("ftdi_sio", 0.016, "slow"))),
        ("model", lambda h: h.params(CONFIGURED + WIDE)),
        ("port", _opening(PortBusyError("/dev/ttyUSB0"))),
    ],
)
def test_minor_problems_are_amber(check, spoil, head):
    spoil(head)
    assert head.check() == 1
    assert head.levels[check] is Grade.AMBER
    assert head.sent or check == "port"  # a port that another program owns is left alone


def test_servos_are_only_pinged_and_read(head):
    """Servos keep torque and position."""
    for servo in head.bus:
        servo.set_register("Torque Enable", 1)
    before = [servo.true_position for servo in head.bus]
    head.check()
    assert len(head.sent) > 100
    assert {data[4] for data in head.sent} == {1, 2}  # PING, READ
    assert [servo.register("Torque Enable") for servo in head.bus] == [1, 1]
    assert [servo.true_position for servo in head.bus] == before


def test_without_hardware_no_port_is_opened(head):
    head.arguments.append("--sim")
    assert head.check() == 0
    assert not head.sent


# Other nodes


@pytest.mark.parametrize(
    ("seconds", "level"),
    [
        (0.0003, Grade.GREEN),
        (0.05, Grade.AMBER),
        (-0.005, Grade.AMBER),
        (3.0, Grade.RED),
        (-0.05, Grade.RED),
    ],
)
def test_clocks_that_differ_are_reported(seconds, level):
    assert check_clocks({"joint_states": 0.0, "t": seconds}).level is level
    assert check_clocks({}).level is Grade.SKIPPED


def test_diagnostics_are_shown(head, monkeypatch):
    diagnostics = {"servo_bus: head_pan_joint": (2, "lost: it does not answer")}
    monkeypatch.setattr(network, "listen", lambda *_: Traffic({}, diagnostics, 3))
    head.arguments = []
    assert head.check() == 2
    assert head.levels["network"] is Grade.GREEN
    assert head.levels["diagnostics"] is Grade.RED


def test_a_middleware_error_is_red(head, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "many")
    head.arguments = ["--listen", "0.1"]
    assert head.check() == 2
    assert head.levels["network"] is Grade.RED


def test_it_runs_without_ros(head, monkeypatch):
    monkeypatch.setitem(sys.modules, network.__name__, None)
    head.arguments = []
    assert head.check() == 1
    assert head.levels["network"] is Grade.AMBER


def test_servos_at_another_baud_rate_are_found_and_named(head):
    head.baud_rate = 57_600
    assert head.check() == Grade.RED
    named = [finding for finding in head.found if "57600" in finding.text]
    assert [finding.check for finding in named] == ["servo 1", "servo 2"]
    assert all("1000000" in finding.text for finding in named)


def test_feetech_servos_are_checked_with_the_offset_in_their_memory(head):
    head.params(head_of("STS3215", ", offset: -85"))
    head.servos(SimulatedServo(1, "STS3215"), SimulatedServo(2, "STS3215"))
    head[1].set_offset(-85)
    assert head.check() == 0
    assert head.levels["servo 1"] is head.levels["servo 2"] is Grade.GREEN
    head[1].set_offset(85)
    head[2].supply_voltage = 9.0
    head.check()
    assert (head.levels["servo 1"], head.levels["servo 2"]) == (Grade.RED, Grade.AMBER)
    assert any("set 1 'Position Offset' -85`" in finding.text for finding in head.found)
