"""The executable servo, as a shell starts it, on a simulated port."""

from __future__ import annotations

import os
import pty
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml

from head_tracking.dynamixel.models import servo_model
from head_tracking.simulation import SimulatedBus, SimulatedPort, SimulatedServo

PATIENCE = 30.0


@pytest.fixture
def simulated(tmp_path: Path) -> Iterator[SimulatedPort]:
    servos = [SimulatedServo(1), SimulatedServo(7, servo_model("XL430-W250"))]
    servos[1].set_register("Baud Rate", 3)
    with SimulatedPort(servos, link=tmp_path / "servos", match_baud_rate=True) as port:
        yield port


def command(port: SimulatedPort, *arguments: str) -> list[str]:
    program = [sys.executable, "-m", "head_tracking.tools.servo.main", "--port", port.port_name]
    return [*program, *arguments]


def run(port: SimulatedPort, *arguments: str, text: str = "") -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command(port, *arguments),
        input=text,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )


class OnTerminal:
    """The program on a terminal of its own."""

    def __init__(self, port: SimulatedPort, *arguments: str) -> None:
        self.master, slave = pty.openpty()
        environment = os.environ | {"TERM": "xterm", "COLUMNS": "100"}
        self.process = subprocess.Popen(
            command(port, *arguments), stdin=slave, stdout=slave, stderr=slave, env=environment
        )
        os.close(slave)
        self.text = ""

    def read_until(self, text: str) -> None:
        deadline = time.monotonic() + PATIENCE
        while text not in self.text:
            assert time.monotonic() < deadline, self.text
            if select.select([self.master], [], [], 0.1)[0]:
                try:
                    self.text += os.read(self.master, 4096).decode(errors="replace")
                except OSError:  # it has ended
                    assert text in self.text, self.text
        self.text = self.text.partition(text)[2]

    def type(self, text: str) -> None:
        os.write(self.master, text.encode())

    def wait(self) -> int:
        return self.process.wait(PATIENCE)

    def end(self) -> None:
        self.process.kill()
        self.process.wait(PATIENCE)
        os.close(self.master)


@pytest.fixture
def start() -> Iterator[Callable[..., OnTerminal]]:
    programs: list[OnTerminal] = []

    def begin(port: SimulatedPort, *arguments: str) -> OnTerminal:
        programs.append(OnTerminal(port, *arguments))
        return programs[-1]

    yield begin
    for program in programs:
        program.end()


def test_scan_over_a_real_port(simulated: SimulatedPort) -> None:
    result = run(simulated, "scan", "--bauds", "57600", "1000000", "--ids", "0-8")
    assert result.returncode == 0
    assert [line.split()[1:3] for line in result.stdout.splitlines()[1:]] == [
        ["1", "AX-12"],
        ["7", "XL430-W250"],
    ]


def test_exit_codes_are_those_of_the_documentation(simulated: SimulatedPort) -> None:
    assert run(simulated, "set", "1", "LED", "1").returncode == 0
    assert run(simulated, "info", "9").returncode == 1
    assert run(simulated, "info").returncode == 2
    assert run(simulated, "set", "1", "Temperature Limit", "60").returncode == 3
    assert simulated.use(lambda bus: bus[1].register("LED")) == 1
    assert simulated.use(lambda bus: bus[1].register("Temperature Limit")) == 70


def test_question_on_a_terminal(start, simulated: SimulatedPort) -> None:
    program = start(simulated, "set", "1", "Temperature Limit", "60")
    program.read_until("[y/N]")
    program.type("y\n")
    assert program.wait() == 0
    assert simulated.use(lambda bus: bus[1].register("Temperature Limit")) == 60


def test_monitor_on_a_terminal_ends_by_ctrl_c(start, simulated: SimulatedPort) -> None:
    program = start(simulated, "monitor", "1", "7")
    program.read_until("XL430-W250")
    program.read_until("XL430-W250")  # again
    program.process.send_signal(signal.SIGINT)
    assert program.wait() == 130


def test_monitor_of_a_port_that_vanishes_fails(start, simulated: SimulatedPort) -> None:
    program = start(simulated, "monitor", "1")
    program.read_until("AX-12")
    simulated.unplug()
    program.read_until("servo: ")
    assert program.wait() == 1


def standing(bus: SimulatedBus) -> bool:
    return bus[1].true_velocity == 0.0


def test_calibrate_on_a_terminal(start, simulated: SimulatedPort, tmp_path: Path) -> None:
    file = tmp_path / "head.yaml"
    program = start(simulated, "calibrate", "head_pan:1", "--output", str(file))
    for tick, prompt in ((512, "zero"), (300, "lowest"), (700, "highest")):
        program.read_until(prompt)
        simulated.use(lambda bus, tick=tick: bus[1].lead(tick, 0.5, 1.0))
        deadline = time.monotonic() + PATIENCE
        while abs(simulated.true_ticks(1) - tick) > 10 or not simulated.use(standing):
            assert time.monotonic() < deadline
            time.sleep(0.02)
        program.type("\n")
    program.read_until("written to")
    assert program.wait() == 0
    motor = yaml.safe_load(file.read_text())["/**/servo_bus"]["ros__parameters"]
    motor = motor["head_pan_controller"]["motor"]
    assert motor["init"] == pytest.approx(512, abs=12)
    assert motor["min"] == pytest.approx(306, abs=14)
    assert motor["max"] == pytest.approx(694, abs=14)


def test_calibrate_with_nobody_there_writes_nothing(
    simulated: SimulatedPort, tmp_path: Path
) -> None:
    file = tmp_path / "head.yaml"
    result = run(simulated, "calibrate", "head_pan:1", "--output", str(file))
    assert result.returncode == 3
    assert "nobody is there" in result.stderr
    assert not file.exists()
