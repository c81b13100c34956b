"""Parameters as a person sees them."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import viser
from hypothesis import given
from hypothesis import strategies as st

from head_tracking.ros.kit.other_parameters import Setting
from head_tracking.viewer.logarithmic_slider import LogarithmicScale, LogarithmicSlider
from head_tracking.viewer.tuning_panel import (
    TuningPanel,
    label,
    make_input,
    sent_value,
    shown_value,
)


def setting(name: str, value: Any, unit: str = "") -> Setting:
    description = f"What it does. [{unit}]" if unit else "What it does."
    return Setting("/node", name, value, description, -math.inf, math.inf)


@pytest.mark.parametrize(
    ("name", "unit", "shown"),
    [
        ("max_velocity", "rad/s", "max velocity (°/s)"),
        ("dead_band", "rad", "dead band (°)"),
        ("target_timeout", "s", "target timeout (s)"),
        ("law", "", "law"),
        ("head_pan_controller.motor.max", "ticks", "head pan motor: max (ticks)"),
    ],
)
def test_names_and_units(name, unit, shown):
    assert label(setting(name, 1.0, unit)) == shown


def test_angles_are_degrees_on_the_page_and_radians_for_the_node():
    angle = setting("dead_band", math.radians(30.0), "rad")
    assert shown_value(angle) == pytest.approx(30.0)
    assert sent_value(angle, 45.0) == pytest.approx(math.radians(45.0))
    seconds = setting("target_timeout", 0.5, "s")
    assert (shown_value(seconds), sent_value(seconds, 0.7)) == (0.5, 0.7)
    whole = setting("motor.max", 1023, "ticks")
    assert sent_value(whole, 1000) == 1000
    assert sent_value(setting("center", [0.0, 1.0], "m"), "1, 2 3") == [1.0, 2.0, 3.0]


def test_only_the_parameters_of_the_law_that_steers_are_shown():
    server = viser.ViserServer(host="127.0.0.1", port=8280, verbose=False)
    try:
        law = Setting("/head_tracker", "law", "speed", "", 0, 0, ("predictive", "speed"))
        others = [
            Setting("/head_tracker", name, 1.0, "[s]", 0.0, 9.0) for name in ("k_pan", "dead_band")
        ]
        values = {"now": [law, *others]}
        panel = TuningPanel(server, SimpleNamespace(settings=lambda: values["now"]))
        panel.refresh()
        assert {name for _, name in panel._inputs} == {"law", "k_pan"}
        values["now"] = [replace(law, value="predictive"), *others]
        panel.refresh()
        assert {name for _, name in panel._inputs} == {"law", "dead_band"}
    finally:
        server.stop()


@given(
    st.floats(1e-6, 1e6),
    st.floats(2.0, 6.0),
    st.booleans(),
    st.floats(0.0, 1.0),
    st.integers(0, 200),
)
def test_a_logarithmic_scale_has_a_place_for_every_number(low, decades, zero, part, step):
    high = low * 10.0**decades
    scale = LogarithmicScale(0.0 if zero else low, high)
    least = high / 1e4 if zero else low
    number = least * (high / least) ** part
    # a slider of 200 steps: half a step is less than 4 % over these six decades
    assert scale.number(scale.place(number)) == pytest.approx(number, rel=0.05)
    place = step / 2.0
    assert scale.place(scale.number(place)) == place
    assert (0.0 if zero else low) <= scale.number(place) <= high
    assert scale.number(0.0) == (0.0 if zero else low)
    assert scale.number(100.0) == high
    assert scale.place(0.0) == 0.0


def test_whole_numbers_and_marks():
    scale = LogarithmicScale(1.0, 100.0, whole=True)
    assert {scale.number(step / 2.0) for step in range(201)} <= set(map(float, range(1, 101)))
    assert scale.marks() == ((0.0, "1"), (50.0, "10"), (100.0, "100"))
    zero = LogarithmicScale(0.0, 3600.0)
    assert [name for _, name in zero.marks()] == ["0", "1", "10", "100", "1k"]


@pytest.mark.parametrize(
    ("low", "high", "value", "description", "logarithmic"),
    [
        (0.1, 20.0, 1.5, "Speed per error.", True),
        (math.radians(1.0), math.radians(100.0), 0.1, "Lead. [rad]", True),
        (1, 100, 5, "Images.", True),
        (1, 5, 3, "Images.", False),
        (0.0, 3600.0, 10.0, "So long; 0: never. [s]", True),
        (0.0, 0.1, 0.01, "Errors below this are left alone. [rad]", False),
        (-1.0, 100.0, 0.0, "Anything.", False),
    ],
)
def test_ranges_over_decades_get_a_logarithmic_slider(low, high, value, description, logarithmic):
    server = viser.ViserServer(host="127.0.0.1", port=8281, verbose=False)
    try:
        one = Setting("/node", "name", value, description, low, high)
        made = make_input(server.gui, one)
        assert isinstance(made, LogarithmicSlider) is logarithmic
        assert made.value == shown_value(one)
        if logarithmic:
            told: list[Any] = []
            made.on_update(lambda event: told.append(made.value))
            made.value = shown_value(replace(one, value=type(value)(high)))
            assert made._slider.value == 100.0
            made.remove()
    finally:
        server.stop()
