"""Random buffers against a plain reference."""

import random

import numpy as np
import pytest
from random_trees import random_urdf

from head_tracking.transforms import (
    Transform,
    TransformBuffer,
    parse_robot_model,
)

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
        many = buffer.transform_points(points, target, source, stamp)
        assert np.allclose(many, there, atol=1e-6)
        elsewhere = {joint: rnd.uniform(-1.5, 1.5) for joint in histories}
        found = buffer.lookup_transform(target, source, stamp, joint_positions=elsewhere).transform
        between = model.transform(frames[target], frames[source], elsewhere)
        expected = (carried[target].inverse() @ between @ carried[source]).as_matrix()
        assert np.allclose(found.as_matrix(), expected, atol=1e-6)
