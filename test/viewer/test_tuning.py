"""Parameters as a person sees them."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import viser

from head_tracking.viewer.observation import Setting
from head_tracking.viewer.tuning_panel import TuningPanel, label, sent_value, shown_value


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
