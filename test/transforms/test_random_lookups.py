"""Random buffers against a plain reference, and random operations against a crash."""

import random

import numpy as np
import pytest
from random_trees import random_urdf

from head_tracking.transforms import (
    RobotModelError,
    Rotation,
    Transform,
    TransformBuffer,
    TransformException,
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
        point = buffer.transform_point((0.3, -0.2, 0.5), target, source, stamp)
        assert np.allclose(point, (expected @ (0.3, -0.2, 0.5, 1.0))[:3], atol=1e-6)


MODELS = [parse_robot_model(random_urdf(seed, links=6)) for seed in range(4)]
NAMES = ("a", "b", "c", "link_0", "link_1", "link_3", "", "/a", "/")


def random_stamp(rnd: random.Random) -> int:
    return rnd.choice((0, 1, 5, 10, 20 * SECOND, rnd.randrange(30 * SECOND)))


def random_number(rnd: random.Random) -> float:
    return rnd.choice((0.0, 1.0, -2.5, 1e300, float("nan"), float("inf"), rnd.random()))


def random_operation(rnd: random.Random, buffer: TransformBuffer) -> None:
    kind = rnd.randrange(12)
    target, source, fixed = rnd.choice(NAMES), rnd.choice(NAMES), rnd.choice(NAMES)
    stamp, other = random_stamp(rnd), random_stamp(rnd)
    if kind < 4:
        rotation = Rotation(0.0, 0.0, 0.0, 1.0) if rnd.random() < 0.8 else Rotation(
            *(random_number(rnd) for _ in range(4))
        )  # fmt: skip
        transform = Transform([random_number(rnd) for _ in range(3)], rotation)
        buffer.set_transform(stamp, target, source, transform, static=rnd.random() < 0.3)
    elif kind < 6:
        joints = {f"joint_{rnd.randrange(6)}": random_number(rnd) for _ in range(rnd.randrange(3))}
        buffer.set_joint_positions(stamp, joints)
    elif kind < 8:
        buffer.lookup_transform(target, source, stamp)
    elif kind == 8:
        buffer.lookup_transform_full(target, stamp, source, other, fixed)
    elif kind == 9:
        buffer.transform_point((1.0, 2.0, 3.0), target, source, stamp)
        buffer.get_latest_common_time(target, source)
    elif kind == 10:
        buffer.lookup_transform(target, source, stamp, joint_positions={"joint_1": 0.5})
    elif rnd.random() < 0.2:
        buffer.clear()
    elif rnd.random() < 0.5:
        buffer.set_model(rnd.choice(MODELS))
    else:
        assert buffer.all_frames_as_string() is not None
        assert buffer.all_frames_as_yaml(stamp)
        assert buffer.tree_as_string(stamp) is not None
        assert buffer.problems(stamp, SECOND) is not None


def test_random_sequences_raise_transform_exceptions_only():
    rnd = random.Random(2026)
    refused = 0
    for _ in range(300):
        buffer = TransformBuffer()
        # eight sequences of operations on a buffer that the ones before have left behind
        for _ in range(8):
            for _ in range(4):
                try:
                    random_operation(rnd, buffer)
                except TransformException:
                    refused += 1
                except RobotModelError:
                    raise AssertionError("a model of the test itself is bad") from None
    assert refused > 2_000
