"""The bus in a process of its own: however the run or the bus ends, the servos are relaxed."""

import os
import re
import signal
import threading
from multiprocessing import Pipe
from pathlib import Path

import pytest
from robot_under_test import wait_for

from head_tracking.dynamixel import DynamixelPort
from head_tracking.nodes.bus_process import Questions


def torque(port: str) -> list[int]:
    with_servos = DynamixelPort(port, 1_000_000, reply_timeout=1.0)
    with_servos.open()
    try:
        return [with_servos.read(servo, 24, 1).data[0] for servo in (1, 2)]
    finally:
        with_servos.close()


def children(process: int) -> list[int]:
    found = Path(f"/proc/{process}/task/{process}/children")
    return [int(word) for word in found.read_text().split()] if found.exists() else []


def test_a_late_answer_is_not_taken_for_the_answer_to_stop():
    ours, theirs = Pipe()
    questions = Questions(ours)

    def answer() -> None:
        first, _ = theirs.recv()
        second, what = theirs.recv()
        theirs.send((first, "a report"))
        theirs.send((second, f"answer to {what}"))

    other = threading.Thread(target=answer)
    other.start()
    assert questions.ask(None, 0.01) is None
    assert questions.ask("stop", 60.0) == "answer to stop"
    other.join()


def alive(process: int) -> bool:
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"  # nobody may be there to wait for it


def test_a_bus_process_tracks_and_is_judged_by_the_true_angles(start, tmp_path):
    file = tmp_path / "servos.yaml"
    file.write_text(
        "servo_bus:\n  ros__parameters:\n"
        "    head_pan_controller: {motor: {id: 6}}\n    head_tilt_controller: {motor: {id: 7}}\n"
    )
    run = start(
        "head_tracking", "--sim", "--bus-process", "--duration", "15", "--params", str(file),
        "--ros-args", "-p", "servo_bus:update_rate:=40.0", "-r", "servo_states:=measured",
    )  # fmt: skip
    run.read_until("(id 7): torque on")
    assert len(children(run.process.pid)) == 1
    assert run.end() == 0, run.output
    assert "2 AX-12 servos: ids 6, 7" in run.output
    pans = [float(pan) for pan in re.findall(r"\| pan +([-+][\d.]+)", run.output, re.MULTILINE)]
    assert max(map(abs, pans)) > 5.0
    last = run.output.splitlines()[-1]
    assert "max by the true servo angles" in last
    assert "did not confirm" not in run.output


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_to_the_run_relaxes_the_head_of_a_bus_process(start, port, number):
    run = start("head_tracking", "--port", port, "--target", "fictitious", "--bus-process")
    run.read_until("head_pan_joint (id 1): torque on")
    (bus,) = children(run.process.pid)
    run.read_until("| bus")
    assert run.end(number) == 0, run.output
    assert torque(port) == [0, 0]
    assert not alive(bus)
    assert "by the measured servo angles" in run.output or "no target" in run.output


@pytest.mark.parametrize("words", ["relaxed until a command comes", "| bus"])
def test_ctrl_c_which_reaches_the_run_and_its_bus_process_ends_both_well(start, words):
    run = start("head_tracking", "--sim", "--bus-process", own_group=True)
    run.read_until(words)
    os.killpg(run.process.pid, signal.SIGINT)
    assert run.end() == 0, run.output
    last = run.output.splitlines()[-1]
    assert "bus cycles" in last or ("stopped before" in last and words != "| bus")
    assert "gone" not in last
    assert "Traceback" not in run.output


def test_a_bus_process_relaxes_and_ends_when_its_run_is_killed(start, port):
    run = start("head_tracking", "--port", port, "--target", "fictitious", "--bus-process")
    run.read_until("head_tilt_joint (id 2): torque on")
    (bus,) = children(run.process.pid)
    run.process.kill()
    wait_for(lambda: not alive(bus))
    assert torque(port) == [0, 0]


def test_a_run_ends_when_its_bus_process_is_killed(start, port):
    run = start("head_tracking", "--port", port, "--target", "fictitious", "--bus-process")
    run.read_until("head_tilt_joint (id 2): torque on")
    (bus,) = children(run.process.pid)
    os.kill(bus, signal.SIGKILL)
    assert run.end() == 1
    last = run.output.splitlines()[-1]
    assert "the servo bus's process has ended (exit code -9)" in last
    assert "Traceback" not in run.output


def test_a_bus_process_that_can_not_start_ends_the_run_with_its_reason(start):
    run = start("head_tracking", "--port", "/dev/ttyNOT0", "--bus-process")
    assert run.end() == 1
    assert "cannot open /dev/ttyNOT0" in run.output
    assert "could not start (exit code 1)" in run.output.splitlines()[-1]
    assert "Traceback" not in run.output


def test_a_bus_process_whose_servos_are_not_confirmed_relaxed_ends_the_run_with_1(start, tmp_path):
    link = str(tmp_path / "servos")
    bus = start("simulated_bus", "--link", link)
    bus.read_until("servos")
    run = start("head_tracking", "--port", link, "--target", "fictitious", "--bus-process")
    run.read_until("head_tilt_joint (id 2): torque on")
    bus.end(signal.SIGINT)
    run.read_until("bus unplugged")
    assert run.end(signal.SIGINT) == 1
    assert "did not confirm that it is relaxed" in run.output
    assert "the servo bus's process ended with exit code 1" in run.output


def test_a_simulated_run_keeps_to_this_machine_unless_told_otherwise(start):
    # ROS's setup.bash says SUBNET on every robot
    for options, kept in (((), "LOCALHOST"), (("--network",), "SUBNET")):
        run = start(
            "head_tracking", "--sim", "--bus-process", *options,
            environment={"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"},
        )  # fmt: skip
        run.read_until("| bus")
        (bus,) = children(run.process.pid)
        words = Path(f"/proc/{bus}/environ").read_bytes().split(b"\0")
        assert f"ROS_AUTOMATIC_DISCOVERY_RANGE={kept}".encode() in words
        assert run.end(signal.SIGINT) == 0
