"""The programs as a person starts and stops them."""

import os
import re
import signal
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path

import pytest
from program_under_test import Program
from robot_under_test import wait_for
from terminal import Terminal

from head_tracking.dynamixel import DynamixelPort, JointConfiguration, ServoBus, ServoNotFoundError


def torque(port: str) -> list[int]:
    with_servos = DynamixelPort(port, 1_000_000, reply_timeout=1.0)
    with_servos.open()
    try:
        return [with_servos.read(servo, 24, 1).data[0] for servo in (1, 2)]
    finally:
        with_servos.close()


def test_a_run_ends_by_itself_with_a_summary(start):
    run = start("head_tracking", "--sim", "--duration", "12")
    assert run.end() == 0
    assert "2 AX-12 servos: ids 1, 2" in run.output
    last = run.output.splitlines()[-1]
    assert "tracking error" in last
    assert "rms" in last
    assert "max by the true servo angles" in last
    assert "bus cycles, " in last
    assert "did not confirm" not in run.output


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_and_relaxes_the_head(start, port, number):
    run = start("head_tracking", "--port", port, "--target", "fictitious")
    run.read_until("head_pan_joint (id 1): torque on")
    run.read_until("| bus")
    assert run.end(number) == 0, run.output
    assert torque(port) == [0, 0]
    assert "by the measured servo angles" in run.output or "no target" in run.output


def test_a_node_that_dies_ends_the_run_with_its_error(start, tmp_path):
    bus = start("simulated_bus", "--link", str(tmp_path / "servos"))
    port = bus.read_until("servos").strip()
    run = start("head_tracking", "--port", os.path.realpath(port))  # a name that never comes back
    run.read_until("ready to keep")
    bus.end(signal.SIGINT)
    assert run.end() == 1
    assert "servo_bus died" in run.output.splitlines()[-1]
    assert "Traceback" not in run.output


def test_an_adapter_that_is_plugged_in_again_is_found(start, tmp_path):
    link = str(tmp_path / "servos")
    bus = start("simulated_bus", "--link", link)
    bus.read_until("servos")
    node = start("servo_bus", "--ros-args", "-p", f"port_name:={link}")
    node.read_until("2 AX-12 servos")
    bus.end(signal.SIGINT)
    node.read_until("lost ")
    again = start("simulated_bus", "--link", link)
    again.read_until("servos")
    node.read_until("is there again")
    node.read_until("(id 2): answers again")
    assert node.end(signal.SIGINT) == 0


def test_a_missing_port_is_an_error(start):
    run = start("head_tracking", "--port", "/dev/ttyNOT0")
    assert run.end() == 1
    last = run.output.splitlines()[-1]
    assert "cannot open /dev/ttyNOT0" in last
    assert "Traceback" not in run.output


def test_a_busy_port_is_an_error(start, port):
    first = start("servo_bus", "--ros-args", "-p", f"port_name:={port}")
    first.read_until("2 AX-12 servos")
    second = start("head_tracking", "--port", port)
    assert second.end() == 1
    assert "another program uses it" in second.output
    assert first.end(signal.SIGINT) == 0


def test_an_id_that_does_not_answer_is_an_error(start, tmp_path):
    bus = start("simulated_bus", "--ids", "1", "7", "--link", str(tmp_path / "servos"))
    port = bus.read_until("servos").strip()
    run = start("head_tracking", "--port", port)
    assert run.end() == 1
    last = run.output.splitlines()[-1]
    assert "2" in last
    assert port in last


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--sim", "--target", "1,2@base_link"], "no target"),
        (["--sim", "--target", "1,nan,2@base_link"], "no target"),
        (["--sim", "--target", "somewhere"], "no target"),
        (["--sim", "--duration", "-1"], "no duration"),
        (["--sim", "--params", "nothing.yaml"], "no file nothing.yaml"),
        (["--sim", "--port", "/dev/ttyUSB0"], "not allowed with"),
        (["--sim", "--mode", "dance"], "invalid choice"),
        (
            ["--sim", "--reverse", "head_pan"],
            "no servo turns head_pan; there are head_pan_joint, head_tilt_joint",
        ),
        (["--simm"], "unrecognized"),
    ],
)
def test_a_mistake_on_the_command_line_is_told(start, arguments, words):
    run = start("head_tracking", *arguments)
    assert run.end() == 2
    assert words in run.output


def test_parameters_come_from_a_file(start, tmp_path):
    file = tmp_path / "servos.yaml"
    file.write_text(
        "servo_bus:\n  ros__parameters:\n"
        "    head_pan_controller: {motor: {id: 6}}\n    head_tilt_controller: {motor: {id: 7}}\n"
    )
    run = start("head_tracking", "--sim", "--duration", "1", "--params", str(file))
    assert run.end() == 0
    assert "2 AX-12 servos: ids 6, 7" in run.output


def test_one_point_can_be_the_target(start):
    run = start(
        "head_tracking", "--sim", "--mode", "point", "--target", "1,0.5,0@base_link",
        "--duration", "6",
    )  # fmt: skip
    run.read_until("arrived: the head misses the target")
    assert run.end() == 0


def test_every_node_runs_alone(start, port, tmp_path):
    servo_bus = start("servo_bus", "--ros-args", "-p", f"port_name:={port}")
    servo_bus.read_until("2 AX-12 servos: ids 1, 2")
    alone = [
        start("robot_state_publisher"),
        start("joint_state_publisher"),
        start("fictitious_target", "--ros-args", "-p", "frame_id:=torso_link"),
    ]
    if find_spec("mcap_ros2") is not None:
        folder = tmp_path / "recordings"
        alone.append(start("recorder", "--ros-args", "-p", f"record_directory:={folder}"))
        alone[-1].read_until("records into")
    tracker = start("head_tracker")
    tracker.read_until("tracking")
    servo_bus.read_until("torque on")
    relax = start("relax")
    assert relax.end() == 0
    assert "head_pan_joint, head_tilt_joint: relaxed" in relax.output
    pointer = start("point_head")
    pointer.read_until("ready to point")
    for program in (pointer, tracker, *reversed(alone), servo_bus):
        assert program.end(signal.SIGINT) == 0, program.output
    assert torque(port) == [0, 0]
    if find_spec("mcap_ros2") is not None:
        from head_tracking.recording.recording_file import read_recording

        (file,) = folder.iterdir()
        with file.open("rb") as stream:
            recording = read_recording(stream)
        assert not recording.notice
        assert {"head_pan_joint", "head_tilt_joint"} <= recording.seen[-1].joints.keys()


def test_the_simulated_bus_takes_any_ids(start, tmp_path):
    bus = start("simulated_bus", "--ids", "3", "--link", str(tmp_path / "one"))
    port = bus.read_until("one").strip()
    three = JointConfiguration("joint", "controller", 3)
    driver = ServoBus(DynamixelPort(port, 1_000_000), [three])
    assert driver.connect() == "1 AX-12 servo: id 3"
    driver.close()
    four = JointConfiguration("joint", "controller", 4)
    with pytest.raises(ServoNotFoundError, match="4"):
        ServoBus(DynamixelPort(port, 57_600), [four]).connect()
    assert bus.end(signal.SIGINT) == 0
    assert not Path(port).is_symlink()


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGQUIT, signal.SIGTERM])
def test_the_servo_bus_ends_well_whoever_ends_it(start, port, number):
    node = start("servo_bus", "--ros-args", "-p", f"port_name:={port}")
    node.read_until("relaxed until a command comes")
    assert node.end(number) == 0, node.output


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGQUIT])
def test_a_run_whose_terminal_is_closed_ends_well(start, number):
    run = start("head_tracking", "--sim")
    run.read_until("| bus")
    assert run.end(number) == 0, run.output


def test_a_run_that_is_stopped_while_it_starts_makes_nothing_more(start, port):
    run = start("head_tracking", "--port", port)
    status = Path(f"/proc/{run.process.pid}/status")
    heard = re.compile(r"SigCgt:\s*(\w+)")
    wait_for(lambda: int(heard.search(status.read_text())[1], 16) >> (signal.SIGTERM - 1) & 1)
    assert run.end(signal.SIGTERM) == 0, run.output
    assert "bus cycles" not in run.output


def test_a_servo_bus_whose_adapter_has_gone_ends_with_1(start, tmp_path):
    bus = start("simulated_bus", "--link", str(tmp_path / "one"))
    port = bus.read_until("one").strip()
    node = start("servo_bus", "--ros-args", "-p", f"port_name:={port}")
    node.read_until("relaxed until a command comes")
    bus.end(signal.SIGINT)
    node.read_until("check the cable")
    assert node.end(signal.SIGINT) == 1, node.output
    assert "did not confirm that it is relaxed" in node.output


# the bus in a process of its own


def children(process: int) -> list[int]:
    found = Path(f"/proc/{process}/task/{process}/children")
    return [int(word) for word in found.read_text().split()] if found.exists() else []


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


def test_relax_without_a_servo_bus_says_so(start):
    relax = start("relax")
    assert relax.end() == 1
    assert "no servo_bus answers" in relax.output


# what a run does without


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("dynamixels: [head_pan]", "no position of head_tilt_joint in joint_states"),
        (
            "head_pan_controller: {joint_name: neck}",
            "no position of head_pan_joint in joint_states",
        ),
    ],
)
def test_a_simulated_head_that_lacks_a_joint_is_said_and_nothing_ends(start, tmp_path, text, words):
    file = tmp_path / "servos.yaml"
    file.write_text(f"servo_bus: {{ros__parameters: {{{text}}}}}\n")
    run = start("head_tracking", "--sim", "--params", str(file))
    run.read_until(words)
    run.read_until("waiting for the head")
    assert run.end(signal.SIGINT) == 0, run.output
    assert "Traceback" not in run.output


def test_a_malformed_parameter_file_is_one_line(start, tmp_path):
    file = tmp_path / "bad.yaml"
    file.write_text("servo_bus:\n  ros__parameters: [\n")
    run = start("head_tracking", "--sim", "--params", str(file))
    assert run.end() == 1
    assert str(file) in run.output.splitlines()[-1]
    assert "Traceback" not in run.output


def test_an_unknown_parameter_ends_the_run_before_anything_moves(start, tmp_path):
    file = tmp_path / "bad.yaml"
    file.write_text("servo_bus: {ros__parameters: {updat_rate: 40.0}}\n")
    run = start("head_tracking", "--sim", "--params", str(file))
    assert run.end() == 1
    last = run.output.splitlines()[-1]
    assert f"{file}: /servo_bus has no parameter updat_rate (is update_rate meant?)" in last


@pytest.mark.parametrize(
    "environment",
    [
        {"HOME": None, "ROS_LOG_DIR": None},
        {"ROS_LOG_DIR": "/proc/none"},
        {"ROS_HOME": "/proc/none"},
    ],
    ids=str,
)
def test_a_run_goes_on_without_a_log_file_and_says_why(start, environment):
    run = start("head_tracking", "--sim", "--duration", "1", environment=environment)
    assert run.end() == 0, run.output
    assert "no log file is written: " in run.output
    assert "ROS_LOG_DIR" in run.output


def test_a_run_whose_reader_has_gone_goes_on(start):
    reader, writer = os.pipe()
    run = start("head_tracking", "--sim", "--duration", "3", stdout=writer)
    os.close(writer)
    os.read(reader, 1)
    os.close(reader)
    assert run.end() == 0


def test_a_run_goes_on_when_the_disk_is_full(start):
    with open("/dev/full", "w") as full:
        assert start("head_tracking", "--sim", "--duration", "2", stdout=full).end() == 0


def test_a_terminal_that_has_only_ascii_gets_ascii(start):
    run = start(
        "head_tracking", "--sim", "--duration", "2", environment={"PYTHONIOENCODING": "ascii"}
    )
    assert run.end() == 0, run.output
    assert re.search(r"pan .*deg tilt .*deg \|", run.output)


# other heads in the graph


def runs(run: Program) -> None:
    """Waits until it has looked for other heads, and moves."""
    run.read_until("head_tilt_joint (id 2): torque on")


def test_a_simulated_run_does_not_turn_a_real_head_and_says_whose_it_is(start, port):
    real = start("servo_bus", "--ros-args", "-p", f"port_name:={port}", "-p", "reply_timeout:=0.5")
    real.read_until("relaxed until a command comes")
    simulated = start("head_tracking", "--sim")
    # (it refuses to start, or holds if it hears of the other one late)
    said = simulated.read_until("another head is in this graph: ")
    assert "/servo_bus (moves servos)" in said
    assert "--allow-others" in said or "this run holds" in said
    assert "Traceback" not in simulated.output
    assert real.end(signal.SIGINT) == 0
    assert "torque on" not in real.output
    assert torque(port) == [0, 0]


def test_a_simulated_run_does_not_turn_a_real_head_that_comes_later(start, port):
    simulated = start("head_tracking", "--sim")
    simulated.read_until("head_tilt_joint (id 2): torque on")
    real = start("servo_bus", "--ros-args", "-p", f"port_name:={port}", "-p", "reply_timeout:=0.5")
    real.read_until("relaxed until a command comes")
    said = simulated.read_until("another head is in this graph")
    assert "/servo_bus (moves servos); this run holds" in said
    assert real.end(signal.SIGINT) == 0
    assert "torque on" not in real.output
    assert torque(port) == [0, 0]


def test_a_key_in_the_terminal_of_a_run_stops_and_resumes_it(domain, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE")
    with closing(Terminal()) as terminal:
        terminal.start("-m head_tracking --sim")
        terminal.waits_for("head_tilt_joint .id 2.: torque on")
        terminal.type(" ")
        terminal.waits_for("STOP: head_pan_joint relaxed, head_tilt_joint relaxed; r resumes")
        terminal.waits_for(r"STOPPED\x1b\[0m \| ")
        terminal.type("r")
        terminal.waits_for("torque on")
        terminal.type("\x03")
        terminal.waits_for(r"stopped once.*\$ ")
        assert terminal.is_as_before()


def test_of_two_simulated_runs_the_second_gives_way(start):
    first = start("head_tracking", "--sim")
    runs(first)
    second = start("head_tracking", "--sim")
    said = second.read_until("another head is in this graph: ")
    assert "/servo_bus (moves servos)" in said
    if "this run holds" not in said:  # it has heard of the first one in time, as is usual
        assert second.end() == 1
        assert first.end(signal.SIGINT) == 0


def test_who_allows_others_runs_beside_them(start):
    runs(start("head_tracking", "--sim"))
    second = start("head_tracking", "--sim", "--allow-others")
    second.read_until("this run goes on")
    assert second.end(signal.SIGINT) == 0


def test_heads_with_names_of_their_own_run_side_by_side(start):
    runs(start("head_tracking", "--sim"))
    second = start(
        "head_tracking", "--sim", "--bus-process", "--duration", "5", "--ros-args", "-r",
        "__ns:=/second",
    )  # fmt: skip
    assert second.end() == 0, second.output
    assert "another head" not in second.output


def test_a_simulated_run_holds_when_somebody_commands_its_servos(start):
    run = start("head_tracking", "--sim")
    runs(run)
    start("head_tracker", "--ros-args", "-r", "__node:=stranger")
    said = run.read_until("another head is in this graph")
    assert "/stranger (turns a head); this run holds" in said


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


# transforms


@pytest.fixture
def running(start) -> Program:
    run = start("head_tracking", "--sim", "--target", "2,0.5,0.6@base_link")
    run.read_until("| bus")
    return run


def test_transforms_echo_prints_where_a_frame_is(start, running):
    echo = start("transforms", "echo", "base_link", "torso_link", "--rate", "20", "--count", "2")
    assert echo.end() == 0, echo.output
    assert echo.output.count("At time ") == 2
    assert "- Translation: [" in echo.output
    assert "- Rotation: in RPY (degree) [0.000, 0.000, 0.000]" in echo.output


def test_transforms_echo_says_why_there_is_nothing(start, running):
    echo = start("transforms", "echo", "base_link", "nose", "--rate", "20")
    assert echo.end() == 1
    assert "nose" in echo.output.splitlines()[-1]
    assert "Traceback" not in echo.output


def test_transforms_tree_draws_frames_rates_and_ages(start, running):
    tree = start("transforms", "tree")
    assert tree.end() == 0, tree.output
    lines = tree.output.splitlines()
    assert lines[0] == "world"
    assert "base_link" in lines[1]
    moving = next(line for line in lines if "Hz" in line)
    assert "head_pan_joint" in moving


def test_transforms_check_finds_nothing_wrong_with_a_running_head(start, running):
    check = start("transforms", "check")
    assert check.end() == 0, check.output
    assert "all of them can be looked up now" in check.output


def test_transforms_without_a_robot_says_so(start):
    tree = start("transforms", "tree", "--wait", "0.5")
    assert tree.end() == 1
    assert "no frame is known" in tree.output


@pytest.mark.parametrize("arguments", [[], ["echo", "a"], ["echo", "a", "b", "--rate", "0"]])
def test_transforms_tells_a_mistake_on_the_command_line(start, arguments):
    program = start("transforms", *arguments)
    assert program.end() == 2
    assert "usage: transforms" in program.output


# targets


def test_look_turns_a_running_head_and_says_by_how_much_it_misses(start):
    run = start("head_tracking", "--sim", "--mode", "point", "--target", "none")
    run.read_until("ready to point")
    look = start("look", "1,1,0.5@base_link")
    assert look.end() == 0, look.output
    assert "arrived: the head misses the target by" in look.output
    look = start("look", "1", "1", "0.4", "--frame", "base_link")
    assert look.end() == 0, look.output
    look = start("look", "--centre")
    assert look.end() == 0, look.output


def test_look_without_a_head_says_so(start):
    look = start("look", "1", "1", "0.5", "--frame", "base_link", "--wait", "1")
    assert look.end() == 1
    assert "no robot_description is published" in look.output
    assert "Traceback" not in look.output


def test_targets_of_several_programs_come_together(start):
    run = start("head_tracking", "--sim", "--target", "mux")
    run.read_until("ready to keep")
    frame = start(
        "frame_target", "--ros-args", "-p", "frame:=left_eye_link", "-p", "offset:=[2.0, 0.0, 0.0]",
        "-r", "target_point:=frame_target/target_point",
    )  # fmt: skip
    run.read_until("looking at frame_target")
    assert frame.end(signal.SIGINT) == 0, frame.output
    run.read_until("looking at nothing")


def test_camera_and_visual_target_run_alone(start):
    pytest.importorskip("cv2", reason="needs OpenCV: pip install -r requirements/vision.txt")
    run = start("head_tracking", "--sim", "--target", "none")
    run.read_until("ready to keep")
    size = ("-p", "width:=160", "-p", "height:=120", "-p", "rate:=5.0")
    camera = start("simulated_camera", "--ros-args", "-p", "scene:=ball", *size)
    finder = start("visual_target", "--ros-args", "-p", "follow:=colour")
    run.read_until("target (")
    for program in (finder, camera):
        assert program.end(signal.SIGINT) == 0, program.output
