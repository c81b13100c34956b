import inspect
import random

import numpy as np
import pytest
from random_trees import random_urdf

from head_tracking.transforms import Joint, JointType, Mimic, Transform, parse_robot_model
from head_tracking.transforms.chain import (
    ConstantStep,
    JointStep,
    PoseStep,
    compile_chain,
    inverted,
    joint_steps,
)
from head_tracking.transforms.straight_line import StraightLine, Term, text

rnd = random.Random(5)


def random_transform() -> Transform:
    numbers = [rnd.uniform(-2, 2) for _ in range(6)]
    return Transform.from_xyz_rpy(numbers[:3], numbers[3:])


def matrix(numbers) -> np.ndarray:
    return tuple.__new__(Transform, numbers).as_matrix()


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, -1, 0), (0, 0, 1), (0.6, 0.0, -0.8)])
@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic"])
@pytest.mark.parametrize("inverse", [False, True])
def test_a_joint_is_compiled_to_what_it_does(axis, kind, inverse):
    joint = Joint("j", JointType(kind), "a", "b", random_transform(), axis)
    steps = joint_steps(joint, Mimic("j", -2.0, 0.3), 0)
    chain = compile_chain(inverted(steps) if inverse else steps, 1)
    for position in (0.0, 0.7, -3.0):
        expected = joint.transform(-2.0 * position + 0.3)
        expected = expected.inverse() if inverse else expected
        assert np.allclose(matrix(chain(position)), expected.as_matrix(), atol=1e-12)


@pytest.mark.parametrize("inverse", [False, True])
def test_a_transform_can_be_an_argument(inverse):
    before, given, after = random_transform(), random_transform(), random_transform()
    chain = compile_chain([ConstantStep(before), PoseStep(0, inverse), ConstantStep(after)], 1)
    expected = before @ (given.inverse() if inverse else given) @ after
    assert np.allclose(matrix(chain(("parent", given))), expected.as_matrix(), atol=1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_chains_through_random_trees_are_the_products_of_their_joints(seed):
    model = parse_robot_model(random_urdf(seed, links=30))
    random_state = random.Random(seed)
    positions = {name: random_state.uniform(-3, 3) for name in model.independent_joints}
    for _ in range(10):
        link = random_state.choice(model.links)
        expected = np.eye(4)
        for joint in reversed(model.joints_above(link)):
            leader = model.leader(joint.name) if joint.moves else None
            position = (
                0.0
                if leader is None
                else leader.multiplier * positions[leader.joint] + leader.offset
            )
            expected = expected @ joint.transform(position).as_matrix()
        found = model.transform(model.root, link, positions).as_matrix()
        assert np.allclose(found, expected, atol=1e-9)


def test_the_way_of_a_chain_without_joints_is_constant():
    a, b = random_transform(), random_transform()
    chain = compile_chain([ConstantStep(a), ConstantStep(b)], 0)
    assert np.allclose(matrix(chain()), (a @ b).as_matrix(), atol=1e-12)


def test_only_joints_on_the_way_are_arguments(kinectbot):
    assert kinectbot.chain("base_link", "camera_link").joints == (
        "head_pan_joint",
        "head_tilt_joint",
    )
    assert kinectbot.chain("head_tilt_link", "camera_link").joints == ("head_tilt_joint",)
    assert kinectbot.chain("base_link", "torso_link").joints == ()


def test_constants_are_multiplied_out_and_sums_computed_once():
    code = StraightLine()
    a, b = Term.variable("a"), Term.variable("b")
    total = a * 2.0 + b + Term(1.0)
    first, second = code.product(total, a), code.product(total * -3.0, b)
    assert len(code.lines) == 1
    function = code.function(["a", "b"], f"({text(first)}, {text(second)})", {})
    assert function(2.0, 5.0) == (20.0, -150.0)


def test_terms_that_cancel_vanish():
    a = Term.variable("a")
    assert text(a - a) == "0.0"
    assert text(a * 0.0 + Term(2.0)) == "2.0"
    assert text(a * 1e-17) == "0.0"
    assert text(-a) == "- a"


def test_nothing_from_a_model_gets_into_the_source_of_a_function():
    urdf = random_urdf(1).replace("joint_1", "import os")
    model = parse_robot_model(urdf)
    for link in model.links:
        chain = model.chain(model.root, link)
        assert not inspect.getclosurevars(chain.numbers).unbound
        assert chain.numbers.__code__.co_names in [(), ("sin",), ("cos",), ("sin", "cos")]


def test_a_step_says_what_it_is():
    step = JointStep(0, Joint("j", JointType.REVOLUTE, "a", "b", Transform.identity()))
    assert inverted([step])[0].inverse
