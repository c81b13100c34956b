"""The program relax, for servos that no running program drives."""

from __future__ import annotations

import subprocess
import sys

import pytest

from head_tracking.dynamixel import servo_model
from head_tracking.simulation import SimulatedPort, SimulatedServo


def relax(*arguments: str) -> int:
    command = [sys.executable, "-m", "head_tracking.tools.relax", *arguments]
    return subprocess.run(command, timeout=60.0, check=False).returncode


@pytest.mark.parametrize(("hold", "torque"), [((), 0), (("--hold",), 1)])
def test_servos_of_a_dead_run_are_relaxed_or_held(hold: tuple[str, ...], torque: int) -> None:
    servos = [SimulatedServo(1), SimulatedServo(2, servo_model("XM430-W350"))]
    with SimulatedPort(servos) as port:
        for servo_id in (1, 2):
            port.use(lambda bus, i=servo_id: bus[i].set_register("Torque Enable", 1))
        chosen = ("--servo", "AX-12:1", "--servo", "XM430-W350:2", *hold)
        assert relax("--port", port.port_name, *chosen) == 0
        for servo_id in (1, 2):
            assert port.use(lambda bus, i=servo_id: bus[i].register("Torque Enable")) == torque


def test_what_does_not_confirm_ends_with_1() -> None:
    with SimulatedPort([SimulatedServo(1)]) as port:
        chosen = ("--servo", "AX-12:1", "--servo", "AX-12:9")
        assert relax("--port", port.port_name, *chosen) == 1
        assert relax("--port", port.port_name, "--servo", "AX-13:1") == 1
    assert relax("--port", "/dev/none", "--servo", "AX-12:1") == 1


@pytest.mark.parametrize(
    "wrong", [("--port", "x"), ("--hold",), ("--port", "x", "--servo", "AX-12")]
)
def test_a_wrong_command_line_ends_with_2(wrong: tuple[str, ...]) -> None:
    assert relax(*wrong) == 2
