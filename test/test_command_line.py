import signal
import sys
from argparse import ArgumentTypeError
from importlib import import_module

import pytest

from head_tracking import programs
from head_tracking.command_line import (
    baud_rate,
    between,
    existing_file,
    exit_code,
    named_id,
    point_in_frame,
    read_by,
    seconds,
    servo_id,
    with_negative_values,
    without_ros_arguments,
    writable_file,
)
from head_tracking.ros.kit.spinning import run_node
from head_tracking.run.options import parse_arguments


@pytest.mark.parametrize(
    ("convert", "text", "value"),
    [
        (seconds, "1e-3", 0.001),
        (between(0.1, 100.0, "Hz"), "0.1", 0.1),
        (between(0.1, 100.0, "Hz"), "100", 100.0),
        (between(0, 508, "us", int), "508", 508),
        (baud_rate, "57600", 57_600),
        (servo_id, "0", 0),
        (servo_id, "253", 253),
        (named_id, "head_pan:1", ("head_pan", 1)),
        (read_by(int, ValueError), "7", 7),
        (point_in_frame, "1,0.5,0@base_link", ((1.0, 0.5, 0.0), "base_link")),
        (point_in_frame, " -1,-0.5,1e-3@left/arm", ((-1.0, -0.5, 0.001), "left/arm")),
        (point_in_frame, "@left/arm", ((0.0, 0.0, 0.0), "left/arm")),
    ],
)
def test_an_allowed_value_is_converted(convert, text, value):
    assert convert(text) == value
    if not isinstance(value, tuple):
        assert type(convert(text)) is type(value)


@pytest.mark.parametrize(
    ("convert", "texts"),
    [
        (seconds, ("0", "-1", "nan", "inf", "1e300", "x")),
        (between(0.1, 100.0, "Hz"), ("0.09", "100.1", "nan", "inf", "x")),
        (between(0, 508, "us", int), ("-1", "509", "1.5", "x")),
        (baud_rate, ("0", "-1", "1e6", "nan", "x")),
        (servo_id, ("254", "-1", "1.0", "x", "")),
        (named_id, ("1", ":1", "head_pan:x")),
        (read_by(int, ValueError), ("x",)),
        (point_in_frame, ("1,2,3", "1,2@a", "1,2,nan@a", "1,2,3@", "1 2 3@a", "@", "")),
        (existing_file, ("/nowhere/x", "/")),
        (writable_file, ("/nowhere/x", "/")),
    ],
)
def test_other_values_are_refused(convert, texts):
    for text in texts:
        with pytest.raises(ArgumentTypeError):
            convert(text)


def test_a_value_with_a_minus_is_not_an_option():
    given = ["--target", "-1,0,0@a", "-.5,0,0@a", "-30deg", "--sim", "-p"]
    marked = with_negative_values(given)
    assert marked == ["--target", " -1,0,0@a", " -.5,0,0@a", " -30deg", "--sim", "-p"]


def test_arguments_of_ros_end_at_two_dashes():
    given = ["--sim", "--ros-args", "-p", "rate:=5", "--", "--viewer", "--ros-args", "-r", "a:=b"]
    assert without_ros_arguments(given) == ["--sim", "--viewer"]


@pytest.mark.parametrize(
    ("target", "node", "parameter"),
    [
        ("@gripper_link", "frame_target", {"frame": "gripper_link"}),
        ("-1,0,0@a", "fictitious_target", None),
        ("bodies", "detection_target", {"source": "bodies"}),
        ("ball", "visual_target", {"follow": "colour"}),
    ],
)
def test_a_run_starts_the_node_of_its_target(target, node, parameter):
    plan = parse_arguments(["--port", "/dev/null", "--target", target])
    (chosen,) = [spec for spec in plan.nodes if spec.name.endswith("_target")]
    assert chosen.name == node
    assert parameter is None or chosen.parameters == parameter


@pytest.mark.parametrize(("words", "port"), [([], {}), (["--port", ""], {"port_name": ""})])
def test_an_empty_port_is_not_the_default(words, port):
    assert parse_arguments(words).nodes[0].parameters == port


@pytest.mark.parametrize(
    ("tool", "words"),
    [
        ("calibrate", "camera --sim --size 0 0"),
        ("calibrate", "camera --sim --marker-id -2"),
        ("calibrate", "camera --sim --output /nowhere/calibration.yaml"),
        ("calibrate", "camera --sim --picture picture.txt"),
        ("calibrate", "camera --sim --picture /nowhere/picture.png"),
        ("doctor.__main__", "--sim --listen nan"),
        ("doctor.__main__", "--sim --baud -5"),
        ("doctor.__main__", "--nonsense"),
        ("servo.main", "--baud 0 scan"),
        ("servo.main", "scan --bauds -1"),
        ("servo.main", "scan --ids 9-3"),
        ("servo.main", "info 300"),
        ("servo.main", "calibrate head_pan"),
        ("servo.main", "monitor --rate 0"),
        ("servo.main", "--model AX-99 info 1"),
        ("new_robot", "my_head --baud 0"),
        ("new_robot", "my-head"),
        ("new_robot", "my_head --pan 300"),
        ("simulated_bus", "--baud 0"),
        ("simulated_bus", "--servo AX-99:1"),
        ("simulated_bus", "--servo AX-12"),
        ("simulated_bus", "--faults 101"),
        ("simulated_bus", "--servo AX-12:300"),
        ("transforms", "echo a b --count 0"),
        ("transforms", "echo a b --rate 0"),
        ("transforms", "tree --listen 1e300"),
        ("look", ""),
        ("look", "1 2 3"),
        ("look", "--centre @a"),
        ("track_report", "--duration 1e300"),
        ("track_report", "--output /nowhere/picture.svg"),
    ],
)
def test_a_wrong_command_line_is_refused_before_anything_is_done(tool, words, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [tool, *words.split()])
    with pytest.raises(SystemExit) as refused:
        import_module(f"head_tracking.cli.{tool}").main()
    assert refused.value.code == (3 if tool.startswith("doctor") else 2)
    assert capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        "--port /dev/ttyUSB0",
        "--target 1,nan,2@a",
        "--params nothing.yaml",
        "--without servo_bus",
        "--robot nobot",
        "--ros-args -r __node:=head",
        "--ros-args --remap __name:=head",
    ],
)
def test_a_run_with_a_wrong_option_is_refused(words, capsys):
    with pytest.raises(SystemExit) as refused:
        parse_arguments(["--sim", *words.split()])
    assert refused.value.code == 2
    assert capsys.readouterr().err


def test_a_misspelt_command_is_refused_with_those_that_exist(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["head_tracking", "docter"])
    assert programs.head_tracking() == 2
    assert "doctor" in capsys.readouterr().err


def test_a_node_with_a_misspelt_argument_does_not_start(monkeypatch, capsys):
    """Else the parameters behind `--ros-arg` would be left out without a word."""
    monkeypatch.setattr(sys, "argv", ["target_mux", "--ros-arg", "-p", "rate:=5.0"])
    with pytest.raises(SystemExit) as refused:
        run_node(lambda: pytest.fail("it has started"))
    assert refused.value.code == 2
    assert "--ros-arg -p" in capsys.readouterr().err


def test_ctrl_c_while_a_program_is_loaded_is_silent(monkeypatch):
    def interrupted(name):
        raise KeyboardInterrupt

    monkeypatch.setattr(programs, "import_module", interrupted)
    assert programs.doctor() == 130


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_tool_is_interrupted_once_by_signals_in_a_row(number):
    """The second one would interrupt what relaxes the servos."""
    ended = []

    def work():
        try:
            signal.raise_signal(number)
        finally:
            signal.raise_signal(signal.SIGINT)
            ended.append(number)

    assert exit_code("tool", work) == 128 + number
    assert ended == [number]
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
