from argparse import ArgumentTypeError

import pytest

from head_tracking.command_line import (
    above_zero,
    between,
    finite,
    point_in_frame,
    read_by,
    seconds,
    servo_id,
    with_points,
)
from head_tracking.run.options import parse_arguments


@pytest.mark.parametrize(
    ("read", "text", "value"),
    [
        (finite, "-1.5", -1.5),
        (above_zero, "1e-3", 0.001),
        (seconds, "20", 20.0),
        (between(0.1, 100.0, "Hz"), "0.1", 0.1),
        (between(0.1, 100.0, "Hz"), "100", 100.0),
        (between(0, 508, "us", int), "508", 508),
        (servo_id, "0", 0),
        (servo_id, "253", 253),
        (read_by(int, ValueError), "7", 7),
    ],
)
def test_what_is_allowed_is_read(read, text, value):
    assert read(text) == value
    assert type(read(text)) is type(value)


@pytest.mark.parametrize(
    ("read", "texts", "complaint"),
    [
        (finite, ("nan", "inf", "x", ""), "is not a finite number"),
        (above_zero, ("0", "-1", "nan", "inf", "x"), "is not a number above 0"),
        (seconds, ("0", "-1", "nan", "inf", "x"), "is no duration; give seconds above 0"),
        (
            between(0.1, 100.0, "Hz"),
            ("0.09", "100.1", "nan", "inf", "x"),
            "is not possible; allowed are 0.1 to 100 Hz",
        ),
        (
            between(0, 508, "us", int),
            ("-1", "509", "1.5", "x"),
            "is not possible; allowed are 0 to 508 us",
        ),
        (servo_id, ("254", "-1", "1.0", "x", ""), "is no servo id; ids are 0 to 253"),
    ],
)
def test_what_is_not_is_refused_with_what_is(read, texts, complaint):
    for text in texts:
        with pytest.raises(ArgumentTypeError) as refusal:
            read(text)
        assert str(refusal.value) == f"{text!r} {complaint}"


def test_a_reader_tells_its_own_reason():
    def read(text):
        raise LookupError(f"no servo is called {text!r}")

    with pytest.raises(ArgumentTypeError, match=r"^no servo is called 'b'$"):
        read_by(read, LookupError)("b")


@pytest.mark.parametrize(
    ("text", "point", "frame"),
    [
        ("1,0.5,0@base_link", (1.0, 0.5, 0.0), "base_link"),
        ("-1,-0.5,1e-3@left/arm", (-1.0, -0.5, 0.001), "left/arm"),
        (" -1,0,0@a", (-1.0, 0.0, 0.0), "a"),
    ],
)
def test_a_point_is_read_with_its_frame(text, point, frame):
    assert point_in_frame(text) == (point, frame)


@pytest.mark.parametrize("text", ["1,2,3", "1,2@a", "1,2,nan@a", "1,2,3@", "1 2 3@a", "@a", ""])
def test_what_is_no_point_is_told(text):
    with pytest.raises(ArgumentTypeError, match="three numbers in metres and a frame"):
        point_in_frame(text)


def test_a_point_that_begins_with_a_minus_is_no_option():
    given = ["--target", "-1,0,0@a", "-.5,0,0@a", "-1", "--sim", "-p"]
    assert with_points(given) == ["--target", " -1,0,0@a", " -.5,0,0@a", "-1", "--sim", "-p"]


@pytest.mark.parametrize(
    ("target", "node", "parameter"),
    [
        ("@gripper_link", "frame_target", {"frame": "gripper_link"}),
        ("bodies", "detection_target", {"source": "bodies"}),
        ("ball", "visual_target", {"follow": "colour"}),
    ],
)
def test_a_run_starts_the_node_of_its_target(target: str, node: str, parameter: dict) -> None:
    plan = parse_arguments(["--port", "/dev/null", "--target", target])
    (chosen,) = [spec for spec in plan.nodes if spec.name.endswith("_target")]
    assert (chosen.name, chosen.parameters) == (node, parameter)


@pytest.mark.parametrize("target", ["@", "balls", "1,2@base_link"])
def test_a_target_that_is_none_ends_with_2(target: str) -> None:
    with pytest.raises(SystemExit, match="2"):
        parse_arguments(["--sim", "--target", target])
