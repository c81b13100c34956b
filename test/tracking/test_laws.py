"""A law is added by an entry in LAWS: its parameters come with it."""

from dataclasses import fields

import pytest

from head_tracking.parameters import parameter_info
from head_tracking.tracking import LAWS, SpeedLimits


@pytest.mark.parametrize("law", LAWS.values())
def test_a_law_has_parameters_of_its_own_class_and_says_what_it_does(law, head):
    assert law(head, 0.02).parameters == law.Parameters()
    assert law(head, 0.02, SpeedLimits(1.0)).limits.max_joint_speed == 1.0
    assert law.description


def test_no_two_parameters_of_the_laws_have_the_same_name():
    kinds = (SpeedLimits, *(law.Parameters for law in LAWS.values()))
    names = [field.name for kind in kinds for field in fields(kind)]
    assert len(names) == len(set(names))
    assert all(parameter_info(field).description for kind in kinds for field in fields(kind))
