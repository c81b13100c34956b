"""Parameters in the page's units, and presets."""

import json
import math
from dataclasses import replace
from typing import Any

import pytest

from head_tracking.page.tuning import Tuning, described, sent_value, shown_value
from head_tracking.ros.kit.others import Setting


def setting(name: str, value: Any, unit: str = "") -> Setting:
    return Setting("/node", name, value, "", -math.inf, math.inf, unit=unit)


class Parameters:
    """Parameters of nodes that accept everything."""

    def __init__(self, *settings: Setting) -> None:
        self.now = {(one.node, one.name): one for one in settings}

    def settings(self) -> tuple[Setting, ...]:
        return tuple(self.now.values())

    def set(self, node: str, name: str, value: Any) -> str:
        self.now[node, name] = replace(self.now[node, name], value=value)
        return name


def test_angles_are_degrees_on_the_page_and_radians_for_the_node():
    angle = setting("dead_band", math.radians(30.0), "rad")
    assert shown_value(angle) == pytest.approx(30.0)
    assert sent_value(angle, 45.0) == pytest.approx(math.radians(45.0))
    assert shown_value(setting("max_joint_acceleration", 80.0, "rad/s^2")) == 4584
    assert shown_value(setting("success_angle_threshold", 0.01, "rad")) == 0.573
    given = setting("servo_dead_band", 0.004, "rad")  # beside a learned value in rad
    assert (shown_value(given), sent_value(given, 0.005)) == (0.004, 0.005)
    assert described(given)["unit"] == "rad"
    seconds = setting("target_timeout", 0.5, "s")
    assert (shown_value(seconds), sent_value(seconds, 0.7)) == (0.5, 0.7)
    fast = replace(angle, minimum=0.0, maximum=100.0)
    assert sent_value(fast, 5730.0) == 100.0, "the right end of a slider, rounded"
    for beyond in (-1.0, 5770.0, 5900.0):
        with pytest.raises(ValueError, match=r"0 to 5729\.58 °"):  # in the page's unit
            sent_value(fast, beyond)
    whole = setting("motor.max", 1023, "ticks")
    assert sent_value(whole, 1000) == 1000
    assert sent_value(setting("center", [0.0, 1.0], "m"), "1, 2 3") == [1.0, 2.0, 3.0]


def test_a_parameter_that_is_no_number_yet_hides_no_other():
    one = Setting("/node", "name", math.nan, "", 0.0, 1.0, unit="rad")
    assert json.loads(json.dumps(described(one), allow_nan=False))["value"] == "nan"
    assert shown_value(replace(one, value=sent_value(one, "0.5"))) == 0.5


@pytest.mark.parametrize(
    ("value", "shown"),
    [(1.0, None), (1.0, math.nan), (1, 1.5), (True, "yes"), ([1.0], "1, b")],
)
def test_values_that_do_not_fit_are_refused(value, shown):
    with pytest.raises(ValueError):
        sent_value(setting("name", value), shown)


def test_only_the_parameters_of_the_law_that_steers_are_listed():
    law = Setting("/head_tracker", "law", "speed", "", 0, 0, ("predictive", "speed"))
    others = [Setting("/head_tracker", name, 1.0, "", 0.0, 9.0) for name in ("k_pan", "dead_band")]
    parameters = Parameters(law, *others)
    tuning = Tuning(parameters)
    assert {one["name"] for one in tuning.listed()} == {"law", "k_pan"}
    parameters.set("/head_tracker", "law", "predictive")
    assert {one["name"] for one in tuning.listed()} == {"law", "dead_band"}


def test_presets_stay_within_limits_and_normal_and_reset_bring_back_what_was_found():
    speed = Setting("/head_tracker", "max_joint_speed", 3.0, "", 0.0, 4.0, unit="rad/s")
    other = Setting("/visual_target", "max_joint_speed", 3.0, "", 0.0, 4.0, unit="rad/s")
    parameters = Parameters(speed, other)
    tuning = Tuning(parameters)

    def values():
        return [one.value for one in parameters.settings()]

    shown = {name: numbers["max_joint_speed"] for name, numbers in tuning.presets().items()}
    assert shown == {"calm": 45.0, "normal": 171.9, "fast": 229.2}
    tuning.choose("calm")
    assert values() == [pytest.approx(math.radians(45.0)), 3.0]
    assert tuning.chosen() == "calm"
    tuning.choose("fast")
    assert values() == [4.0, 3.0]
    assert tuning.chosen() == "fast"
    tuning.choose("normal")
    assert values() == [3.0, 3.0]
    assert tuning.chosen() == "normal"
    tuning.set("/visual_target", "max_joint_speed", 10.0)
    tuning.reset()
    assert values() == [3.0, 3.0]
    with pytest.raises(ValueError):
        tuning.choose("furious")
    with pytest.raises(ValueError):
        tuning.set("/head_tracker", "serial_port", 1.0)
