import random

import numpy as np
import pytest
from random_trees import random_urdf

from head_tracking.transforms import Joint, JointType, Mimic, Transform, parse_robot_model
from head_tracking.transforms.chain import Chain, sampled, sampled_inverse

rnd = random.Random(5)


def random_transform() -> Transform:
    numbers = [rnd.uniform(-2, 2) for _ in range(6)]
    return Transform.from_xyz_rpy(numbers[:3], numbers[3:])


STILL = Transform.identity()
CONSTANTS = (STILL, Transform.from_xyz_rpy((1, -2, 3)), random_transform())


def itself(value):
    return value


@pytest.mark.parametrize("before", CONSTANTS)
@pytest.mark.parametrize("after", CONSTANTS)
@pytest.mark.parametrize("axis", [(1, 0, 0), (0, -1, 0), (0, 0, 1), (0.6, 0.0, -0.8)])
@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic"])
@pytest.mark.parametrize("inverse", [False, True])
def test_a_joint_with_its_constants_is_what_it_does(axis, kind, inverse, before, after):
    joint = Joint("j", JointType(kind), "a", "b", STILL, axis)
    steps = joint.steps(Mimic("j", -2.0, 0.3), back=inverse)
    chain = Chain([before, *steps, after], [itself])
    for position in (0.0, 0.7, -3.0):
        motion = joint.motion(-2.0 * position + 0.3)
        expected = before @ (motion.inverse() if inverse else motion) @ after
        found = chain.transform(position).as_matrix()
        assert np.allclose(found, expected.as_matrix(), atol=1e-14)


@pytest.mark.parametrize("before", CONSTANTS)
@pytest.mark.parametrize("after", CONSTANTS)
@pytest.mark.parametrize("inverse", [False, True])
def test_a_measured_transform_with_its_constants(inverse, before, after):
    given = random_transform()
    step = sampled_inverse if inverse else sampled
    chain = Chain([before, step, after], [itself])
    expected = before @ (given.inverse() if inverse else given) @ after
    found = chain.transform(("parent", given)).as_matrix()
    assert np.allclose(found, expected.as_matrix(), atol=1e-14)


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


def test_a_chain_without_links_is_constant():
    a, b = random_transform(), random_transform()
    assert np.allclose(Chain([a, b], []).transform(0).as_matrix(), (a @ b).as_matrix(), atol=1e-14)
    assert Chain([], []).transform(0) == STILL


def test_only_joints_on_the_way_are_arguments(kinectbot):
    assert kinectbot.chain("base_link", "camera_link").joints == (
        "head_pan_joint",
        "head_tilt_joint",
    )
    assert kinectbot.chain("head_tilt_link", "camera_link").joints == ("head_tilt_joint",)
    assert kinectbot.chain("base_link", "torso_link").joints == ()
