import io
import random

import numpy as np
import pytest
import yourdfpy
from random_trees import random_urdf

from head_tracking.transforms import LookupException, RobotModel, parse_robot_model


def yourdfpy_model(model: RobotModel) -> yourdfpy.URDF:
    return yourdfpy.URDF.load(io.BytesIO(model.urdf.encode()), load_meshes=False)


@pytest.mark.parametrize("seed", range(3))
def test_forward_kinematics_of_random_trees_agree_with_yourdfpy(seed):
    rnd, model = random.Random(seed), parse_robot_model(random_urdf(seed))
    reference = yourdfpy_model(model)
    for _ in range(5):
        positions = {name: rnd.uniform(-3, 3) for name in model.independent_joints}
        reference.update_cfg(positions)
        for _ in range(10):
            target, source = rnd.choice(model.links), rnd.choice(model.links)
            ours = model.transform(target, source, positions).as_matrix()
            theirs = reference.get_transform(source, target)
            assert np.abs(ours - theirs).max() < 1e-9


def test_both_robots_have_a_camera_and_a_limited_head(robot):
    assert {"camera_link", "camera_optical_frame"} <= set(robot.links)
    tilt = robot.joints["head_tilt_joint"].limits
    assert (tilt.lower, tilt.upper) == (-1.084, 1.472)
    assert robot.joints["head_pan_joint"].limits.velocity < 7


def test_every_link_has_a_plausible_mass(robot):
    for link in yourdfpy_model(robot).robot.links:
        if link.inertial is not None:
            assert 0.001 < link.inertial.mass < 5
            assert np.all(np.linalg.eigvalsh(link.inertial.inertia) > 0)
        else:
            assert link.name.endswith("_frame")


def test_unknown_links_and_missing_positions_are_named(kinectbot):
    with pytest.raises(LookupException):
        kinectbot.transform("base_link", "nose_link", {})
    with pytest.raises(LookupException):
        kinectbot.transform("base_link", "camera_link", {"head_tilt_joint": 0.0})
