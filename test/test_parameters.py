import math

import pytest

from head_tracking.parameters import ParameterInfo, checked

SPEED = ParameterInfo("Speed.", "rad/s", 0.1, 2.0)


def test_a_whole_number_is_taken_for_a_float():
    assert checked("speed", SPEED, 1.0, 2) == 2.0
    assert type(checked("speed", SPEED, 1.0, 2)) is float


@pytest.mark.parametrize("value", [0.0, 3.0, -1.0, math.nan, math.inf])
def test_a_number_out_of_range_is_refused_with_the_range(value):
    with pytest.raises(ValueError, match=r"speed is .*; allowed is 0.1 to 2 rad/s"):
        checked("speed", SPEED, 1.0, value)


@pytest.mark.parametrize("value", ["fast", True, None, [1.0]])
def test_a_wrong_type_is_refused(value):
    with pytest.raises(ValueError, match="must be a number"):
        checked("speed", SPEED, 1.0, value)


def test_each_element_of_a_list_is_checked():
    assert checked("xyz", SPEED, (0.0,), [1, 2.0]) == (1.0, 2.0)
    with pytest.raises(ValueError, match=r"xyz\[1\] is 9"):
        checked("xyz", SPEED, (0.0,), [1, 9])
    with pytest.raises(ValueError, match="must be a list"):
        checked("xyz", SPEED, (0.0,), "1 2 3")


def test_words_can_be_limited():
    info = ParameterInfo("Law.", choices=("speed", "position"))
    assert checked("law", info, "speed", "position") == "position"
    with pytest.raises(ValueError, match="allowed are speed, position"):
        checked("law", info, "speed", "magic")
