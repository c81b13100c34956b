"""Robot models and the buffer beside plain references: yourdfpy, and joints one by one."""

import io
import random
from dataclasses import astuple

import numpy as np
import pytest
import yourdfpy

from head_tracking.transforms import (
    JointState,
    JointStates,
    LookupException,
    Transform,
    TransformBuffer,
    parse_robot_model,
)

AXES = (
    "1 0 0",
    "0 1 0",
    "0 0 -1",
    "0.6 0 0.8",
    "0.2672612419124244 0.5345224838248488 -0.8017837257372732",
)


def random_urdf(seed: int, links: int = 20) -> str:
    """A tree of `links` links under all joint types, some joints mimicking an independent one."""
    rnd = random.Random(seed)
    parts = [f'<robot name="random_{seed}">', '<link name="link_0"/>']
    followed = ""
    for number in range(1, links):
        kind = rnd.choice(("fixed", "revolute", "continuous", "prismatic"))
        parts += [
            f'<link name="link_{number}"/>',
            f'<joint name="joint_{number}" type="{kind}">',
            f'<parent link="link_{rnd.randrange(number)}"/><child link="link_{number}"/>',
            f'<origin xyz="{_numbers(rnd, 0.5)}" rpy="{_numbers(rnd, 3.0)}"/>',
        ]
        if kind != "fixed":
            parts.append(f'<axis xyz="{rnd.choice(AXES)}"/>')
            if kind != "continuous":
                parts.append('<limit lower="-3" upper="3" effort="1" velocity="1"/>')
            if followed and rnd.random() < 0.25:
                parts.append(
                    f'<mimic joint="{followed}" multiplier="{rnd.uniform(-2, 2)}" '
                    f'offset="{rnd.uniform(-1, 1)}"/>'
                )
            else:
                followed = followed or f"joint_{number}"
        parts.append("</joint>")
    return "\n".join([*parts, "</robot>"])


def _numbers(rnd: random.Random, size: float) -> str:
    return " ".join(f"{rnd.uniform(-size, size):.6f}" for _ in range(3))


@pytest.mark.parametrize("seed", range(3))
def test_forward_kinematics_of_random_trees_agree_with_yourdfpy(seed):
    rnd, model = random.Random(seed), parse_robot_model(random_urdf(seed))
    reference = yourdfpy.URDF.load(io.BytesIO(model.urdf.encode()), load_meshes=False)
    for _ in range(5):
        positions = {name: rnd.uniform(-3, 3) for name in model.independent_joints}
        reference.update_cfg(positions)
        for _ in range(10):
            target, source = rnd.choice(model.links), rnd.choice(model.links)
            ours = model.transform(target, source, positions).as_matrix()
            theirs = reference.get_transform(source, target)
            assert np.abs(ours - theirs).max() < 1e-9


def test_unknown_links_and_missing_positions_are_named(kinectbot):
    with pytest.raises(LookupException):
        kinectbot.transform("base_link", "nose_link", {})
    with pytest.raises(LookupException):
        kinectbot.transform("base_link", "camera_link", {"head_tilt_joint": 0.0})


SECOND = 1_000_000_000


@pytest.mark.parametrize("seed", range(3))
def test_lookups_in_a_moving_robot_are_those_of_its_model(seed):
    """Each joint is measured at times of its own; a link carries a frame of another program."""
    rnd = random.Random(seed)
    model = parse_robot_model(random_urdf(seed))
    buffer, histories = TransformBuffer(), {}
    buffer.set_model(model)
    for joint in model.independent_joints:
        stamps = [0, *sorted(rnd.sample(range(1, 80), 20)), 80]
        history = [(SECOND + s * SECOND // 10, rnd.uniform(-1.5, 1.5)) for s in stamps]
        histories[joint] = np.array(history).T
        for stamp, position in rnd.sample(history, len(history)):
            buffer.set_joint_positions(stamp, {joint: position})
    hand, tool = rnd.choice(model.links), Transform.from_xyz_rpy((1, 2, 3), (0.1, 0.2, 0.3))
    for stamp in (SECOND, 9 * SECOND):
        buffer.set_transform(stamp, hand, "tool", tool)
    carried = dict.fromkeys(model.links, Transform.identity()) | {"tool": tool}
    frames = {link: link for link in model.links} | {"tool": hand}
    for _ in range(200):
        target, source = rnd.choice(list(frames)), rnd.choice(list(frames))
        stamp = rnd.choice(
            [rnd.randrange(SECOND, 9 * SECOND), rnd.randrange(10, 90) * SECOND // 10]
        )
        joints = {joint: np.interp(stamp, *known) for joint, known in histories.items()}
        found = buffer.lookup_transform(target, source, stamp).transform
        between = model.transform(frames[target], frames[source], joints)
        expected = (carried[target].inverse() @ between @ carried[source]).as_matrix()
        assert np.allclose(found.as_matrix(), expected, atol=1e-6)
        points = np.array([(0.3, -0.2, 0.5), (-1.0, 0.7, 2.0)])
        there = points @ expected[:3, :3].T + expected[:3, 3]
        one = buffer.transform_point(points[0], target, source, stamp)
        assert np.allclose(one, there[0], atol=1e-6)
        assert np.allclose(found.apply_many(points), there, atol=1e-6)
        elsewhere = {joint: rnd.uniform(-1.5, 1.5) for joint in histories}
        found = buffer.lookup_transform(target, source, stamp, joint_positions=elsewhere).transform
        between = model.transform(frames[target], frames[source], elsewhere)
        expected = (carried[target].inverse() @ between @ carried[source]).as_matrix()
        assert np.allclose(found.as_matrix(), expected, atol=1e-6)


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


def test_a_stated_default_stands_until_it_is_measured():
    states = JointStates(parse_robot_model(CHAIN), {"first": 0.25})
    assert is_same(states.complete({})["third"], JointState(2.5))
    assert is_same(states.complete({"first": JointState(0.5)})["first"], JointState(0.5))
