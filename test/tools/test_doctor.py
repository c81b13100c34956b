"""doctor: each of its checks in a case in which it is red, and what it must not do."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from random import Random
from typing import Any

import pytest
from simulated_device import Bench, SimulatedDevice

from head_tracking.dynamixel import (
    Adapter,
    DynamixelPort,
    PortBusyError,
    PortMissingError,
    PortPermissionError,
    servo_model,
)
from head_tracking.dynamixel.protocol import ErrorBits
from head_tracking.simulation import (
    Fault,
    Faults,
    SimulatedBus,
    SimulatedJoints,
    SimulatedLine,
    SimulatedServo,
)
from head_tracking.tools.doctor import main as tool
from head_tracking.tools.doctor.configuration import configured_buses
from head_tracking.tools.doctor.findings import Finding, Level
from head_tracking.tools.doctor.machine import Machine, Processor, measure_processor
from head_tracking.tools.doctor.network import Heard
from head_tracking.tools.doctor.servos import owner

SOURCE = Path(__file__).resolve().parents[2]
QUIET = Processor(4, 3.5, 0.0002)
XM = servo_model("XM430-W350")
X_HEAD = """
/**/servo_bus:
  ros__parameters:
    head_pan_controller:
      motor: {model: XM430-W350, id: 1, init: 2048, min: 1024, max: 3072}
    head_tilt_controller:
      motor: {model: XM430-W350, id: 2, init: 2048, min: 1500, max: 2600}
"""


def heard(**changes: Any) -> Heard:
    """What is heard of a head in order."""
    sent = [(n * 20_000_000, n * 20_000_000 + 300_000, n * 20_000_000) for n in range(1, 9)]
    usual: dict[str, Any] = {
        "nodes": ("/servo_bus", "/head_tracker"),
        "sent": {"servo_states": sent, "target_point": sent},
        "commanders": ("/head_tracker",),
        "diagnostics": {"servo_bus: /dev/ttyUSB0": (0, "50.0 of 50.0 cycles per second")},
    }
    return Heard(**(usual | changes))


class Head:
    """Two simulated servos on a port, and the doctor who looks at them."""

    def __init__(self, tmp_path: Path) -> None:
        self.tmp_path = tmp_path
        self.bench = Bench([SimulatedServo(1), SimulatedServo(2)])
        self.adapter = Adapter("ftdi_sio", 0.001)
        self.latency = 0.0  # s
        self.opening: Callable[[], object] = lambda: None
        self.listening: Callable[[], Heard] = lambda: self.heard
        self.machine: dict[str, Any] = {}
        self.environment: dict[str, str] = {}
        self.missing: dict[str, str] = {}
        self.heard = heard()
        self.arguments: list[str] = []
        self.baud_rate = 0  # the only one that servos hear; 0: any
        self.sent: list[bytes] = []
        self.findings: list[Finding] = []

    def servos(self, *servos: SimulatedServo, faults: Faults | None = None) -> None:
        self.bench = Bench(SimulatedBus(servos, faults=faults))

    def __getitem__(self, servo_id: int) -> SimulatedServo:
        return self.bench.bus[servo_id]

    def params(self, text: str) -> None:
        file = self.tmp_path / "params.yaml"
        file.write_text(text)
        self.arguments += ["--params", str(file)]

    def _make_port(self, name: str, baud_rate: int) -> DynamixelPort:
        def open_device(*_: object) -> SimulatedDevice:
            self.opening()
            line = SimulatedLine(self.bench.bus, self.bench.clock, baud_rate, latency=self.latency)
            device = SimulatedDevice(line)
            device.adapter = self.adapter
            write = line.write

            def note(data: bytes, timeout: float) -> None:
                self.sent.append(data)
                if self.baud_rate in (0, baud_rate):
                    write(data, timeout)

            line.write = note  # type: ignore[method-assign]
            return device

        return DynamixelPort(
            name,
            baud_rate,
            reply_timeout=0.03,
            open_device=open_device,
            clock=self.bench.clock,
        )

    def look(self, capsys: pytest.CaptureFixture[str]) -> int:
        machine = Machine(
            **(
                {
                    "python": (3, 12),
                    "system": "Linux aarch64",
                    "environment": self.environment,
                    "problem": lambda name: self.missing.get(name, ""),
                    "processor": lambda: QUIET,
                    "proc": self.tmp_path,
                }
                | self.machine
            )
        )
        bus = {"make_port": self._make_port, "proc": self.tmp_path}
        looks = tool.Looks(machine, bus, lambda *_: self.listening())
        code = tool.main(self.arguments, looks)
        self.output = capsys.readouterr().out
        return code

    def levels(self) -> dict[str, str]:
        """Check and colour of what was printed; the worst of those of one name."""
        found: dict[str, str] = {}
        order = ["-", "green", "amber", "red"]
        for line in self.output.splitlines():
            if line.startswith(tuple(f"{word:5}  " for word in order)):
                word, check = line[:5].strip(), line[7:25].strip()
                found[check] = max(word, found.get(check, "-"), key=order.index)
        return found


@pytest.fixture
def head(tmp_path: Path) -> Head:
    return Head(tmp_path)


def _raise(error: Exception) -> None:
    raise error


def _on(servo: SimulatedServo, register: str, value: int) -> None:
    servo.set_register(register, value)


def _slow_adapter(head: Head) -> None:
    head.latency = 0.016
    head.adapter = Adapter("ftdi_sio", 0.016, "its latency timer is 16 ms")


def _two_with_one_id(head: Head) -> None:
    head.bench = Bench(
        SimulatedBus([SimulatedServo(1), SimulatedServo(1, position=100), SimulatedServo(2)])
    )


def _machine(**changes: Any) -> Callable[[Head], None]:
    return lambda head: head.machine.update(changes)


def _environment(**variables: str) -> Callable[[Head], None]:
    return lambda head: head.environment.update(variables)


def _missing(**modules: str) -> Callable[[Head], None]:
    return lambda head: head.missing.update(modules)


def _hear(**changes: Any) -> Callable[[Head], None]:
    def hear(head: Head) -> None:
        head.heard = heard(**changes)

    return hear


def _opening(error: Exception) -> Callable[[Head], None]:
    def refuse(head: Head) -> None:
        head.opening = lambda: _raise(error)

    return refuse


def _later(seconds: float) -> Mapping[str, list[tuple[int, int, int]]]:
    late = round(seconds * 1e9)
    return {"target_point": [(n, n + late, n) for n in range(10**9, 10**9 + 8)]}


def _spoilt(head: Head) -> None:
    head.params(X_HEAD)
    head.servos(SimulatedServo(1, XM, firmware=255), SimulatedServo(2, XM))


def _other_middleware(head: Head) -> None:
    index = head.tmp_path / "share/ament_index/resource_index/rmw_typesupport"
    index.mkdir(parents=True)
    (index / "rmw_fastrtps_cpp").touch()
    head.environment |= {"AMENT_PREFIX_PATH": str(head.tmp_path), "RMW_IMPLEMENTATION": "rmw_x_cpp"}


def _disturbed(head: Head) -> None:
    faults = Faults(Random(1), 0.0, [Fault.CORRUPT])
    head.servos(SimulatedServo(1), SimulatedServo(2), faults=faults)
    head.opening = lambda: setattr(faults, "rate", 0.3)


def _hot(head: Head) -> None:
    head[1].temperature = 66.0


RED: dict[str, tuple[Callable[[Head], None], str]] = {
    "Python": (_machine(python=(3, 10)), "Python 3.11 to 3.13 is needed"),
    "libraries": (_missing(yourdfpy="ModuleNotFoundError: no"), "head_setup yourdfpy"),
    "for some things": (_missing(cv2="ImportError: numpy.core"), "numpy must be below 2"),
    "ROS": (_environment(ROS_DISTRO="humble"), "source /opt/ros/jazzy"),
    "RMW": (_other_middleware, "apt install ros-jazzy-rmw-x-cpp"),
    "ROS_DOMAIN_ID": (_environment(ROS_DOMAIN_ID="233"), "use 0 to 101"),
    "discovery": (_environment(ROS_AUTOMATIC_DISCOVERY_RANGE="HOME"), "use one of SUBNET"),
    "security": (_environment(ROS_SECURITY_ENABLE="true"), "create_keystore"),
    "processor": (_machine(processor=lambda: Processor(4, 0.1, 0.02)), "see with `top`"),
    "configuration": (
        lambda head: head.params("servo_bus: {ros__parameters: {head_pan_controller.motor.id: x}}"),
        "config/head.yaml is an example",
    ),
    "model": (lambda head: head.arguments.extend(["--robot", "nobody"]), "check_model"),
    "port": (_opening(PortMissingError("/dev/ttyUSB0", ())), "plug the adapter in"),
    "rights": (_opening(PortPermissionError("/dev/ttyUSB0", "dialout")), "usermod -a -G dialout"),
    "baud rate": (lambda head: setattr(head, "baud_rate", 57_600), "set baud_rate: 57600"),
    "ids": (_two_with_one_id, "set-id"),
    "models": (
        lambda head: head.servos(SimulatedServo(1, servo_model("AX-18")), SimulatedServo(2)),
        "correct motor.model",
    ),
    "settings": (lambda head: _on(head[1], "CCW Angle Limit", 0), "servo set"),
    "firmware": (_spoilt, "Dynamixel Wizard"),
    "voltage": (lambda head: setattr(head[2], "supply_voltage", 5.5), "charge the battery"),
    "temperature": (_hot, "let it cool"),
    "errors": (lambda head: head[1].overload(), "call recover"),
    "latency timer": (_slow_adapter, "head_setup udev"),
    "line": (_disturbed, "check plugs"),
    "nodes": (_hear(nodes=("/servo_bus", "/servo_bus")), "end one of them"),
    "clock skew": (_hear(sent=_later(-0.05)), "chrony"),
    "stamps of targets": (_hear(sent=_later(3.0)), "stamp each point"),
    "joint_commands": (_hear(commanders=("/_NODE_NAME_UNKNOWN_",)), "keep others out"),
    "diagnostics": (
        _hear(diagnostics={"servo_bus: head_pan_joint": (2, "lost: it does not answer")}),
        "by symptom",
    ),
}


@pytest.mark.parametrize("check", RED)
def test_each_check_is_red_where_it_should_be_and_says_what_to_do(
    check: str,
    head: Head,
    capsys: pytest.CaptureFixture[str],
) -> None:
    spoil, cure = RED[check]
    spoil(head)
    assert head.look(capsys) == 2
    assert head.levels().get(check) == "red", head.output
    assert cure in head.output
    assert "something is red" in head.output


def test_a_head_in_order_is_green_and_every_check_has_a_case_in_which_it_is_red(
    head: Head, capsys: pytest.CaptureFixture[str]
) -> None:
    assert head.look(capsys) == 0
    assert head.levels() == dict.fromkeys(RED, "green")
    assert "all is green" in head.output


@pytest.mark.parametrize(
    ("spoil", "check"),
    [
        (lambda head: setattr(head[1], "supply_voltage", 10.0), "voltage"),
        (lambda head: setattr(head[1], "temperature", 62.0), "temperature"),
        (
            lambda head: setattr(head, "adapter", Adapter("ftdi_sio", 0.016, "slow")),
            "latency timer",
        ),
        (_environment(ROS_DOMAIN_ID="150"), "ROS_DOMAIN_ID"),
        (_environment(ROS_AUTOMATIC_DISCOVERY_RANGE="OFF"), "discovery"),
        (_hear(sent=_later(0.05)), "clock skew"),
        (_hear(commanders=("/head_tracker", "/viewer")), "joint_commands"),
    ],
)
def test_what_is_worth_a_look_is_amber(
    spoil: Callable[[Head], None], check: str, head: Head, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil(head)
    assert head.look(capsys) == 1
    assert head.levels()[check] == "amber"


def test_servos_whose_memory_holds_each_other_s_limits_are_called_swapped(
    head: Head, capsys: pytest.CaptureFixture[str]
) -> None:
    head.params(
        "servo_bus: {ros__parameters: {head_pan_controller: {motor: {min: 100, max: 900}}}}"
    )
    for servo, limits in ((head[1], (300, 800)), (head[2], (100, 900))):
        _on(servo, "CW Angle Limit", limits[0])
        _on(servo, "CCW Angle Limit", limits[1])
    assert head.look(capsys) == 2
    assert "servo 1 (head_pan_joint) has the angle limits meant for servo 2" in head.output


def test_servos_are_pinged_and_read_and_nothing_else(
    head: Head, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also servos with torque on keep it, and stand where they stood."""
    for servo in head.bench.bus:
        _on(servo, "Torque Enable", 1)
    before = [servo.true_position for servo in head.bench.bus]
    head.look(capsys)
    assert len(head.sent) > 100
    assert {data[4] for data in head.sent} == {1, 2}  # PING, READ
    assert [servo.register("Torque Enable") for servo in head.bench.bus] == [1, 1]
    assert [servo.true_position for servo in head.bench.bus] == before


def test_a_port_that_another_program_owns_is_left_alone_and_its_owner_is_named(
    head: Head, capsys: pytest.CaptureFixture[str]
) -> None:
    head.opening = lambda: _raise(PortBusyError("/dev/ttyUSB0"))
    assert head.look(capsys) == 1
    assert head.levels()["port"] == "amber"
    assert not head.sent
    assert "diagnostics" in head.levels()


def test_the_owner_of_a_real_port_is_found_and_its_bus_is_not_disturbed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    buses = configured_buses([SOURCE / "config" / "head.yaml"])
    hold = (
        "import sys, time\n"
        "from head_tracking.dynamixel import DynamixelPort\n"
        "port = DynamixelPort(sys.argv[1]); port.open(); print('open', flush=True)\n"
        "time.sleep(60)\n"
    )
    with SimulatedJoints(buses[0].joints) as joints:
        command = [sys.executable, "-c", hold, joints.port_name]
        with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=SOURCE) as process:
            try:
                assert process.stdout is not None
                assert process.stdout.readline() == b"open\n"
                assert owner(joints.port_name).startswith(f"process {process.pid}: ")
                machine = Machine(problem=lambda name: "no" if name == "rclpy" else "")
                tool.main(["--port", joints.port_name, "--listen", "0"], tool.Looks(machine))
            finally:
                process.kill()
    said = capsys.readouterr().out
    assert f"belongs to process {process.pid}" in said


def test_without_ros_the_servos_are_looked_at_all_the_same(
    head: Head, capsys: pytest.CaptureFixture[str]
) -> None:
    head.missing["rclpy"] = "ModuleNotFoundError: No module named 'rclpy'"
    assert head.look(capsys) == 1
    assert head.levels()["ROS"] == "amber"
    assert head.levels()["network"] == "-"
    assert head.levels()["voltage"] == "green"
    assert "has no wheels for this machine" in head.output


def test_a_middleware_that_makes_no_node_is_named(
    head: Head, capsys: pytest.CaptureFixture[str]
) -> None:
    def listen() -> Heard:
        raise RuntimeError("error creating node: no security here, at /project/src/node.c:252")

    head.listening = listen
    assert head.look(capsys) == 2
    assert head.levels()["network"] == "red"
    assert "error creating node: no security here\n" in head.output
    (head.tmp_path / "enclaves").mkdir()
    head.environment |= {
        "ROS_SECURITY_ENABLE": "true",
        "ROS_SECURITY_STRATEGY": "Enforce",
        "ROS_SECURITY_KEYSTORE": str(head.tmp_path),
    }
    assert head.look(capsys) == 2
    assert (head.levels()["security"], head.levels()["network"]) == ("red", "-")
    assert "enforced" not in head.output


@pytest.fixture(scope="module")
def bare() -> Iterator[list[str]]:
    """A Python that has nothing but itself."""
    yield [sys.executable, "-I", "-S", "-c"]


def test_it_starts_where_no_library_is_installed_and_names_what_is_missing(
    bare: list[str],
) -> None:
    code = (
        f"import sys; sys.path.insert(0, {str(SOURCE)!r})\n"
        "from head_tracking.tools.doctor.main import main; sys.exit(main([]))\n"
    )
    done = subprocess.run([*bare, code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2, done.stderr
    assert "sudo apt install ros-jazzy-dynamixel-sdk" in done.stdout
    assert not done.stderr


def test_the_processor_is_really_measured() -> None:
    seen = measure_processor()
    assert 0.0 <= seen.idle <= seen.cores
    assert -0.001 < seen.late < 5.0


def test_a_wrong_command_line_is_no_verdict(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ending:
        tool.main(["--nonsense"])
    assert ending.value.code == 3


def test_an_ax_error_bit_is_told_by_name(head: Head, capsys: pytest.CaptureFixture[str]) -> None:
    head[1].alarms.forced = int(ErrorBits.INPUT_VOLTAGE)
    assert head.look(capsys) == 2
    assert "input voltage" in head.output


def test_levels_are_ordered_as_exit_codes() -> None:
    assert [int(level) for level in Level] == [-1, 0, 1, 2]
