from dataclasses import astuple

import pytest

from head_tracking.transforms import JointState, JointStates, parse_robot_model

CHAIN = """
<robot name="chain">
  <link name="a"/><link name="b"/><link name="c"/><link name="d"/>
  <joint name="third" type="continuous"><parent link="c"/><child link="d"/>
    <mimic joint="second" multiplier="3" offset="1"/></joint>
  <joint name="second" type="continuous"><parent link="b"/><child link="c"/>
    <mimic joint="first" multiplier="2"/></joint>
  <joint name="first" type="continuous"><parent link="a"/><child link="b"/></joint>
</robot>"""


def is_same(one, other):
    """Compare two states; since Python 3.13 a dataclass with NaN is not equal to itself."""
    return astuple(one) == pytest.approx(astuple(other), nan_ok=True)


@pytest.fixture
def model():
    return parse_robot_model(CHAIN)


def test_what_follows_a_measured_joint_is_added_in_any_order(model):
    assert model.independent_joints == ("first",)
    turned, _, _ = model.transform("a", "d", {"first": 0.1}).rotation.as_rpy()
    assert turned == pytest.approx(0.1 + 0.2 + 1.6)
    states = JointStates(model, {}).complete({"first": JointState(0.5, 1.0, 0.2)})
    assert is_same(states["first"], JointState(0.5, 1.0, 0.2))
    assert is_same(states["second"], JointState(1.0, 2.0))
    assert is_same(states["third"], JointState(4.0, 6.0))


def test_a_stated_default_stands_until_it_is_measured(model):
    states = JointStates(model, {"first": 0.25})
    assert is_same(states.complete({})["third"], JointState(2.5))
    assert is_same(states.complete({"first": JointState(0.5)})["first"], JointState(0.5))


def test_a_measured_follower_is_believed(model):
    states = JointStates(model, {}).complete({"first": JointState(0.5), "second": JointState(0.9)})
    assert is_same(states["second"], JointState(0.9))
