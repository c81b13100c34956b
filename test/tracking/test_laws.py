"""The simple laws and the constants of the documents; a law is added by an entry in LAWS."""

import re
from dataclasses import fields
from pathlib import Path

import pytest

from head_tracking.gaze import together
from head_tracking.parameters import parameter_info
from head_tracking.tracking import LAWS, SpeedLaw, SpeedLimits


@pytest.fixture
def law(head):
    return SpeedLaw(head, 0.1)


def test_no_two_parameters_of_the_laws_have_the_same_name():
    kinds = (SpeedLimits, *(law.Parameters for law in LAWS.values()))
    names = [field.name for kind in kinds for field in fields(kind)]
    assert len(names) == len(set(names))
    assert all(parameter_info(field).description for kind in kinds for field in fields(kind))


def test_both_joints_arrive_together_at_speeds_above_zero():
    command = together((0.0, 0.0), (1.0, -0.25), 2.0)
    assert (command.pan_speed, command.tilt_speed) == (2.0, 0.5)
    for goal in ((1.0, 0.3), (0.0, 0.3)):
        assert together((0.0, 0.3), goal, 2.0).tilt_speed > 0


def test_names_and_defaults_of_the_law_speed_are_the_tutorials(law):
    p = law.parameters
    assert (p.k_pan, p.k_tilt) == (1.5, 1.5)
    assert (p.pan_threshold, p.tilt_threshold) == (0.01, 0.01)
    assert law.limits.lead_target_angle == 0.5


@pytest.mark.parametrize(
    ("limit", "wanted", "present", "goals", "speeds"),
    [
        (0.0, (0.2, -0.1), (0.0, 0.0), (0.5, -0.5), (0.3, 0.15)),
        (0.0, (2.0, -2.0), (0.0, 0.0), (0.5, -0.5), (0.5, 0.5)),
        (0.2, (2.0, -2.0), (0.0, 0.0), (0.5, -0.5), (0.2, 0.2)),
        (0.0, (2.5, 1.3), (2.4, 1.2), (2.6, 1.47), (0.15, 0.15)),
    ],
)
def test_speeds_of_the_law_speed_follow_the_errors(head, limit, wanted, present, goals, speeds):
    command = SpeedLaw(head, 0.1, SpeedLimits(max_joint_speed=limit)).step(wanted, present)
    assert (command.pan, command.tilt) == pytest.approx(goals)
    assert (command.pan_speed, command.tilt_speed) == pytest.approx(speeds)


def test_inside_the_threshold_the_joint_stays_where_it_stopped(law):
    law.step((0.2, 0.2), (0.0, 0.0))
    assert law.step((0.2, 0.2), (0.195, 0.195)).pan == 0.195
    # it sags by less than the threshold: the goal does not follow the sag
    assert law.step((0.2, 0.2), (0.191, 0.191)).pan == 0.195
    assert law.step((0.2, 0.2), (0.1, 0.191)).pan == pytest.approx(0.6)


ROOT = Path(__file__).parents[2]
PARTS = re.split(r"^`(\w+\.py)`$", (ROOT / "docs/explain/estimator.md").read_text(), flags=re.M)
TABLES = dict(zip(PARTS[1::2], PARTS[2::2], strict=True))


@pytest.mark.parametrize("name", TABLES)
def test_every_constant_is_listed_with_its_value_and_origin(name):
    (file,) = (ROOT / "head_tracking").rglob(f"*/{name}")
    rows = set(re.findall(r"^\| (`.*`) \| (.*?) \| .* \| [tbdp] \|$", TABLES[name], re.M))
    found = re.findall(r"^(_?[A-Z][A-Z_, ]*) = (\d[\de., +*/-]*?)(?=  #|$)", file.read_text(), re.M)
    assert rows >= {(", ".join(f"`{each}`" for each in names.split(", ")), value)
                    for names, value in found}  # fmt: skip
