import math

import pytest

from head_tracking.configuration import configured_head
from head_tracking.exceptions import HeadTrackingError
from head_tracking.parameters import ParameterError, ParameterInfo, allowed, checked

SPEED = ParameterInfo("Speed.", "rad/s", 0.1, 2.0)


@pytest.mark.parametrize(
    ("default", "value"),
    [
        *((1.0, bad) for bad in (0.0, 3.0, -1.0, math.nan, math.inf)),  # out of range
        *((1.0, bad) for bad in ("fast", True, None, [1.0])),  # of another type
        ((0.0,), [1, 9]),
        ((0.0,), "1 2 3"),
    ],
)
def test_a_value_out_of_range_or_of_another_type_is_refused(default, value):
    with pytest.raises(ParameterError) as refused:
        checked("speed", SPEED, default, value)
    assert "speed" in str(refused.value)
    assert checked("speed", SPEED, (0.0,), [1, 2.0]) == (1.0, 2.0)


NAMES = ParameterInfo("Topic.", ros_name=True)


@pytest.mark.parametrize("name", ["~", "~/a", "/a/b_1", "a/{node}", "{ns}/a"])
def test_a_name_in_ros_is_accepted(name):
    assert checked("topic", NAMES, "", name) == name
    assert checked("topic", NAMES, "", "") == ""


@pytest.mark.parametrize("name", ["a b", "/", "a/", "a//b", "/a/1b", "~a", "{x}", "a\n", "ä"])
def test_a_name_that_ros_would_refuse_is_refused(name):
    with pytest.raises(ParameterError):
        checked("topic", NAMES, "", name)
    with pytest.raises(ParameterError):
        checked("topics", NAMES, ("servo_states",), ["servo_states", ""])
    with pytest.raises(ParameterError):
        checked("topics", NAMES, ("servo_states",), ["left", "left"])


@pytest.mark.parametrize(
    ("content", "fact"),
    [
        ("{baud_rate: fast}", "baud_rate is 'fast'"),
        ("{baud_rat: 57600}", "baud_rate meant"),
        ("{head_pan_controller: {motor: {idd: 3}}}", "head_pan_controller.motor.id"),
        ("{head_tilt_controller: {motor: {id: 2, mni: 375}}}", "motor.mni"),
        ("{eeprom: {return_delay: low}}", "eeprom.return_delay"),
        ("{dynamixels: 3}", "list"),
        ("{dynamixels: [head_pan, head_pan]}", "dynamixels"),
        ("[a]", "ros__parameters"),
        ("{a: [1", "YAML"),
    ],
)
def test_a_mistake_in_the_parameter_file_of_a_robot_is_named_with_the_file(tmp_path, content, fact):
    file = tmp_path / "mine.yaml"
    file.write_text(f"/**/servo_bus: {{ros__parameters: {content}}}")
    with pytest.raises(HeadTrackingError) as error:
        configured_head([file])
    assert str(file) in str(error.value)
    assert fact in str(error.value)


@pytest.mark.parametrize(
    "content",
    [
        "{use_sim_time: true}",
        "{neck_controller: {motor: {id: 7, idd: 3}}}",
        "{update_rate: 5e1}",
        "{eeprom: {return_delay: 0}}",
    ],
)
def test_other_values_of_a_robot_file_are_no_mistake(tmp_path, content):
    file = tmp_path / "mine.yaml"
    file.write_text(f"/**/servo_bus: {{ros__parameters: {content}}}")
    configured_head([file])


def test_the_values_of_two_heads_in_one_file_are_not_mixed(tmp_path):
    file = tmp_path / "mine.yaml"
    one, other = "/left/servo_bus: {ros__parameters: {baud_rate: 57600}}", "/right/servo_bus: {}"
    for content in (one, f"{one}\n{other}"):
        file.write_text(content)
        assert configured_head([file]).baud_rate == 57_600
    file.write_text(f"{one}\n{other.replace('{}', '{ros__parameters: {update_rate: 30}}')}")
    with pytest.raises(ParameterError) as error:
        configured_head([file])
    assert "/left/servo_bus, /right/servo_bus" in str(error.value)


def test_a_misspelt_node_in_the_parameter_file_of_a_robot_is_named(tmp_path):
    """Else the limits of the servos would be left out without a word."""
    file = tmp_path / "mine.yaml"
    file.write_text("/**/servobus: {ros__parameters: {baud_rate: 57600}}")
    with pytest.raises(HeadTrackingError) as error:
        configured_head([file])
    assert "servo_bus" in str(error.value)
    for other in ("servo_bus_left", "face_tracker"):
        file.write_text(f"/**/{other}: {{ros__parameters: {{rate: 5}}}}")
        configured_head([file])


def test_allowed_numbers_are_written_as_users_write_them():
    assert allowed(ParameterInfo("", "bit/s", 9_600, 4_500_000)) == "9600 to 4500000 bit/s"
    assert allowed(ParameterInfo("", maximum=0.25)) == "0.25 or less"
