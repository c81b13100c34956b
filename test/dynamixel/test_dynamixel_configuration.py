from __future__ import annotations

import math
from dataclasses import replace

import pytest

from head_tracking.dynamixel import (
    ConfigurationError,
    JointConfiguration,
    check_configuration,
    servo_model,
)

STEP = math.radians(300.0) / 1024
PAN = JointConfiguration("head_pan_joint", 1, controller="head_pan_controller")
TILT = JointConfiguration("head_tilt_joint", 2, 512, 300, 800, controller="head_tilt_controller")
REVERSED = JointConfiguration("head_pan_joint", 1, 500, 800, 200, controller="head_pan_controller")


@pytest.mark.parametrize(
    "joint", [PAN, TILT, REVERSED, replace(PAN, init=0), replace(PAN, init=1023)]
)
def test_every_tick_round_trips(joint: JointConfiguration) -> None:
    for tick in range(1024):
        assert joint.ticks(joint.position(tick)) == tick


def test_zero_is_at_init_and_positions_rise_with_ticks() -> None:
    joint = replace(PAN, init=400)
    assert joint.position(400) == 0.0
    assert joint.position(401) == pytest.approx(STEP)


def test_positions_of_a_reversed_servo_fall_with_ticks() -> None:
    assert REVERSED.direction == -1
    assert REVERSED.position(501) == pytest.approx(-STEP)


def test_no_load_speed_is_the_limit_unless_configured() -> None:
    assert PAN.speed_limit == servo_model("AX-12").no_load_speed
    assert replace(PAN, joint_speed=0.5, max_speed=1.0).speed_limit == 1.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"min": -1}, "min: -1"),
        ({"max": 1024}, "max: 1024 .*0 to 1023"),  # the tutorial's
        ({"init": 1024}, "init: 1024"),
        ({"init": 200, "min": 300}, "min: 300 and max: 1023 .* init: 200"),
        ({"init": 900, "min": 800, "max": 200}, "init: 900"),
        ({"min": 512, "max": 512}, "min: 512 and max: 512"),
        ({"init": 512.0}, "whole number"),
        ({"max": True}, "whole number"),
        ({"id": 254}, "0 to 253"),
        ({"id": -1}, "0 to 253"),
        ({"id": "1"}, "0 to 253"),
        ({"model": "AX-12"}, "model is .AX-12."),
        ({"joint_name": " "}, "joint_name must be a name"),
        ({"controller": ""}, "controller must be a name"),
        ({"joint_speed": math.nan}, "joint_speed: nan"),
        ({"joint_speed": 0.0}, "joint_speed: 0.0"),
        ({"joint_speed": -1.0}, "joint_speed: -1.0"),
        ({"joint_speed": 100.0}, "joint_speed: 100.0"),
        ({"joint_speed": "fast"}, "joint_speed: 'fast'"),
        ({"max_speed": math.inf}, "max_speed: inf"),
        ({"max_speed": 0.0}, "max_speed: 0.0"),
    ],
)
def test_impossible_configuration_is_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        replace(PAN, **change)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (replace(TILT, id=1), "id 1 is used twice, by head_pan_joint and head_tilt_joint"),
        (replace(TILT, joint_name="head_pan_joint"), "joint_name head_pan_joint is used twice"),
        (replace(TILT, controller="head_pan_controller"), "controller head_pan_controller"),
    ],
)
def test_joints_may_not_share(other: JointConfiguration, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        check_configuration([PAN, other])


def test_bus_without_joints_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="no joint"):
        check_configuration([])
