from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from head_tracking.dynamixel import (
    ConfigurationError,
    JointConfiguration,
    check_configuration,
    servo_model,
)
from head_tracking.dynamixel.configuration import TemperatureParameters

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


def test_zero_is_at_init_and_positions_of_a_reversed_servo_fall_with_ticks() -> None:
    joint = replace(PAN, init=400)
    assert joint.position(400) == 0.0
    assert joint.position(401) == pytest.approx(STEP)
    assert REVERSED.direction == -1
    assert REVERSED.position(501) == pytest.approx(-STEP)


def test_no_load_speed_is_the_limit_unless_configured() -> None:
    assert PAN.speed_limit == servo_model("AX-12").no_load_speed
    assert replace(PAN, joint_speed=0.5, max_speed=1.0).speed_limit == 1.0


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("min", [-1]),
        ("max", [1024, True]),  # 1024 is the tutorial's
        ("init", [1024, 512.0]),
        ("id", [254, -1, "1"]),
        ("model", ["AX-12"]),
        ("joint_name", [" "]),
        ("controller", [""]),
        ("joint_speed", [math.nan, 0.0, -1.0, 100.0, "fast"]),
        ("max_speed", [math.inf, 0.0]),
        ("reverse", [True]),  # an AX-12 has no such setting
    ],
)
def test_impossible_configuration_is_refused(name: str, values: list[object]) -> None:
    for value in values:
        with pytest.raises(ConfigurationError, match=name):
            replace(PAN, **{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("low", "zero", "high"), [(300, 200, 1023), (800, 900, 200), (512, 512, 512)]
)
def test_a_zero_outside_the_range_is_refused(low: int, zero: int, high: int) -> None:
    with pytest.raises(ConfigurationError, match="min"):
        replace(PAN, min=low, init=zero, max=high)


@pytest.mark.parametrize("name", ["id", "joint_name", "controller"])
def test_joints_may_not_share(name: str) -> None:
    other = replace(TILT, **{name: getattr(PAN, name)})
    with pytest.raises(ConfigurationError, match=name):
        check_configuration([PAN, other])


def test_bus_without_joints_is_refused() -> None:
    with pytest.raises(ConfigurationError):
        check_configuration([])


@pytest.mark.parametrize(
    "option",
    [
        *({"warn": value} for value in (66.0, -math.inf)),
        {"error": 69.0},
        *({"rest": value} for value in (math.nan, math.inf)),
    ],
)
def test_senseless_temperatures_are_refused(option: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError):
        TemperatureParameters(**option)
