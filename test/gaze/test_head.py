import functools
import itertools
import math
import random

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from head_tracking.gaze import GazeStatus, PanTiltHead
from head_tracking.gaze.head_parameters import HeadParameters
from head_tracking.transforms import RobotModel, RobotModelError, Rotation, parse_robot_model

PAN, TILT = "head_pan_joint", "head_tilt_joint"


def head_urdf(
    pan_axis: str = "0 0 1",
    tilt_axis: str = "0 1 0",
    pan_rpy: str = "0 0 0",
    tilt_rpy: str = "0 0 0",
    camera_rpy: str = "0 0 0",
    tilt_xyz: str = "0.03 -0.02 0.05",
    camera_xyz: str = "0.05 0.03 0.0615",
    limit: float = 2.0,
) -> str:
    bounds = f'<limit lower="{-limit}" upper="{limit}"/>'
    return f"""
    <robot name="head">
      <link name="base"/><link name="pan"/><link name="tilt"/><link name="camera"/>
      <joint name="{PAN}" type="revolute"><parent link="base"/><child link="pan"/>
        <origin xyz="0.1 0.02 0.5" rpy="{pan_rpy}"/><axis xyz="{pan_axis}"/>{bounds}</joint>
      <joint name="{TILT}" type="revolute"><parent link="pan"/><child link="tilt"/>
        <origin xyz="{tilt_xyz}" rpy="{tilt_rpy}"/><axis xyz="{tilt_axis}"/>{bounds}</joint>
      <joint name="mount" type="fixed"><parent link="tilt"/><child link="camera"/>
        <origin xyz="{camera_xyz}" rpy="{camera_rpy}"/></joint>
    </robot>"""


SQUARE = {
    "ordinary": {},
    "pan axis down": {"pan_axis": "0 0 -1"},
    "tilt axis right": {"tilt_axis": "0 -1 0"},
    "both turned": {"pan_axis": "0 0 -1", "tilt_axis": "0 -1 0"},
    "pan joint upside down": {"pan_rpy": "3.141592653589793 0 0", "pan_axis": "0 0 -1"},
    "tilt servo on its side": {"tilt_rpy": "1.5707963267948966 0 0", "tilt_axis": "0 0 -1"},
    "camera looks up by default": {"camera_rpy": "0 -0.6 0"},
    "camera rolled": {"camera_rpy": "0.9 0 0"},
    "leaning torso": {"pan_rpy": "0.2 0.3 -0.4"},
}
ASIDE = [{"camera_rpy": f"0.3 0 {aside}"} for aside in (0.8, -1.2)]  # cameras that look aside
CROOKED = {"pan_rpy": "0.3 -0.1 0.2", "tilt_rpy": "0.1 0.2 -0.15", "camera_rpy": "0.3 0.1 -0.2"}


def make_head(options: dict[str, str]) -> tuple[RobotModel, PanTiltHead]:
    return parsed_head(head_urdf(**options))


@functools.cache
def parsed_head(urdf: str) -> tuple[RobotModel, PanTiltHead]:
    model = parse_robot_model(urdf)
    return model, PanTiltHead(model, PAN, TILT, "camera")


def miss_by_matrices(model, target, pan, tilt):
    """From products of matrices alone, for a camera that looks along x."""
    seen = np.array(target)
    for name, angle in ((PAN, pan), (TILT, tilt), ("mount", 0.0)):
        joint = model.joints[name]
        turned = Rotation.from_axis_angle(joint.axis, angle).as_matrix()
        seen = joint.origin.rotation.as_matrix().T @ (seen - joint.origin.translation)
        seen = turned.T @ seen
    return math.atan2(math.hypot(seen[1], seen[2]), seen[0])


def reachable_targets(model, head):
    rnd = random.Random(1)
    for _ in range(50):
        pan, tilt = rnd.uniform(-1.2, 1.2), rnd.uniform(-1.2, 1.2)
        T_base_camera = model.transform(
            head.base_frame, head.pointing_frame, {PAN: pan, TILT: tilt}
        )
        yield T_base_camera @ (10 ** rnd.uniform(-0.5, 1.0), 0.0, 0.0)


def nearly_square(rnd):
    """A head as URDFs have them: right angles rounded, or off by up to 0.1 degrees."""
    off = math.radians(0.1)
    right_angle = rnd.choice([1.5708, 1.57, 1.571, 1.5707963])
    a, b, c, d = (rnd.uniform(-off, off) for _ in range(4))
    return {
        "tilt_rpy": f"{right_angle} 0 0" if rnd.random() < 0.5 else f"{right_angle + a} {b} 0",
        "tilt_axis": "0 0 -1",
        "camera_rpy": f"-{right_angle} {c} {d}",
        "tilt_xyz": f"{rnd.uniform(-0.1, 0.1)} {rnd.uniform(-0.05, 0.05)} 0.05",
        "camera_xyz": f"{rnd.uniform(-0.05, 0.1)} {rnd.uniform(-0.1, 0.1)} 0.06",
    }


def crooked(rnd):
    """A head with axes and camera up to 17 degrees askew, all turned somehow."""

    def three(most):
        return " ".join(str(rnd.uniform(-most, most)) for _ in range(3))

    return {
        "pan_rpy": three(3.0),
        "tilt_rpy": three(0.3),
        "camera_rpy": three(0.3),
        "pan_axis": rnd.choice(["0 0 1", "0 0 -1", "0.1 -0.2 1"]),
        "tilt_axis": rnd.choice(["0 1 0", "0 -1 0"]),
        "tilt_xyz": three(0.1),
        "camera_xyz": three(0.1),
    }


@pytest.mark.parametrize(
    ("options", "most"),
    [
        *((options, 1e-13) for options in SQUARE.values()),
        *((nearly_square(random.Random(seed)), 1e-13) for seed in range(6)),
        *((crooked(random.Random(seed)), 1e-9) for seed in range(8)),
        *((options, 1e-12) for options in ASIDE),
    ],
)
def test_a_head_of_any_build_is_pointed_exactly(options, most):
    rnd = random.Random(1)
    model, head = make_head(options)
    for target in reachable_targets(model, head):
        gaze = head.gaze(target, rnd.uniform(-1, 1), rnd.uniform(-1, 1))
        assert gaze.status is GazeStatus.REACHED, gaze
        assert gaze.miss < most
        assert miss_by_matrices(model, target, gaze.pan, gaze.tilt) < most
        ray = head.ray(target, gaze.pan, gaze.tilt)
        if ray is None:  # two gazes merge there
            assert math.dist(target, (0.1, 0.02, 0.5)) < 0.8
            continue
        assert miss_by_matrices(model, target, ray.pan, ray.tilt) < most


@settings(max_examples=100)
@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3), st.floats(-2, 2), st.floats(-2, 2))
def test_a_nearly_square_head_answers_as_a_square_one(target, pan, tilt):
    model, square = make_head({})
    _, head = make_head({"camera_rpy": "0 0 1e-5", "tilt_axis": "0 1 1e-5"})
    x, y, z = model.transform("pan", "base", {PAN: 0.0, TILT: 0.0}) @ target
    assume(math.hypot(x, y) > 0.2)  # nearer, a little askew is another pan
    assume(math.hypot(x - 0.03, z - 0.05) > 0.3)
    expected, gaze = (each.gaze(target, pan, tilt) for each in (square, head))
    on_the_edge = any(
        abs(abs(position) - 2.0) < 1e-3 for position in (expected.pan, expected.tilt)
    ) and (expected.status is not gaze.status)
    assume(not on_the_edge)
    assert gaze.status is expected.status
    if abs(gaze.pan - expected.pan) < 0.5:  # behind the back, a little askew is the other side
        assert gaze.miss == pytest.approx(expected.miss, abs=1e-3)


def test_any_axis_can_be_pointed(kinectbot):
    head = PanTiltHead(kinectbot, PAN, TILT, "head_link", pointing_axis=(2.0, 0.0, 1.0))
    target = (1.0, 0.4, 0.2)
    gaze = head.gaze(target, 0.0, 0.0)
    norm = math.sqrt(5)
    axis = (2 / norm, 0.0, 1 / norm)
    assert head.pointing_axis == pytest.approx(axis)
    assert gaze.reached
    positions = {PAN: gaze.pan, TILT: gaze.tilt}
    seen = kinectbot.transform("head_link", head.base_frame, positions) @ target
    assert np.linalg.norm(np.cross(axis, seen)) < 1e-7
    assert np.dot(axis, seen) > 0.0


BEHIND = ((-1.0, 0.6, 0.3), (0.0, -1.0, -1.0), (1.0, -1.0, 0.2))
OBLIQUE = {"tilt_axis": "0 0.36 1", "limit": 1.0}


@pytest.mark.parametrize(
    ("options", "targets"),
    [
        *((options, BEHIND) for options in ({}, *(crooked(random.Random(i)) for i in range(8)))),
        (OBLIQUE, ((2.7, 2.7, -2.7), (2.4, -1.4, 2.5))),
    ],
)
def test_the_answer_out_of_reach_is_the_nearest_gaze(options, targets):
    _, head = make_head(options)
    grid = [head.pan_limits.upper * (i / 40 - 1.0) for i in range(81)]
    for target, present in itertools.product(targets, (0.0, -1.9, 1.9)):
        gaze = head.gaze(target, present, 0.0)
        best = min(head.miss(target, p, t) for p in grid for t in grid)
        assert gaze.miss == pytest.approx(head.miss(target, gaze.pan, gaze.tilt))
        assert gaze.miss <= best + math.radians(4)


def test_a_target_behind_the_head_does_not_turn_it_from_limit_to_limit(robot):
    head = PanTiltHead(robot, PAN, TILT, "camera_link")
    pan = head.pan_limits.upper
    for aside in (0.1, -0.1, 0.1):
        assert head.gaze((-2.0, aside, 0.5), pan, 0.0).pan == pan


def test_a_target_on_the_pan_axis_keeps_the_pan(kinectbot):
    head = PanTiltHead(kinectbot, PAN, TILT, "camera_link")
    gaze = head.gaze((0.0115, 0.0, 2.0), 0.7, 0.1)
    assert gaze.status is GazeStatus.ON_PAN_AXIS
    assert gaze.pan == 0.7
    assert gaze.tilt == kinectbot.joints[TILT].limits.lower
    # one that can look straight up
    model, head = make_head({"tilt_xyz": "0 0 0.1", "camera_xyz": "0.1 0 0"})
    gaze = head.gaze((0.1, 0.02, 2.0), 0.7, 0.1)
    assert gaze.reached
    assert gaze.pan == 0.7
    assert miss_by_matrices(model, (0.1, 0.02, 2.0), gaze.pan, gaze.tilt) < 1e-9
    assert head.ray((0.1, 0.02, 2.0), 0.7, 0.1)[:2] == pytest.approx((gaze.pan, gaze.tilt))


def test_a_target_at_the_camera_is_too_close(robot):
    head = PanTiltHead(robot, PAN, TILT, "camera_link")
    at_camera = robot.transform(head.base_frame, "camera_link", {PAN: 0.4, TILT: 0.3}).translation
    assert head.gaze(at_camera, 0.4, 0.3).status is GazeStatus.TOO_CLOSE


@settings(max_examples=100)
@given(st.tuples(*[st.floats(allow_nan=True, allow_infinity=True)] * 3), st.floats(-9, 9))
def test_gaze_never_raises_and_never_leaves_the_limits(target, present):
    for options in ({}, CROOKED):
        _, head = make_head(options)
        gaze = head.gaze(target, present, present)
        assert head.pan_limits.contains(gaze.pan)
        assert head.tilt_limits.contains(gaze.tilt)
        assert gaze.reached == (gaze.reason == "")
        if not all(map(math.isfinite, target)):
            assert gaze.status is GazeStatus.NOT_FINITE
            assert (gaze.pan, gaze.tilt) == (max(-2.0, min(present, 2.0)),) * 2


def test_limits_can_be_narrowed(kinectbot):
    head = PanTiltHead(kinectbot, PAN, TILT, "camera_link", tilt_limits=(-0.3, 0.3))
    gaze = head.gaze((1.0, 0.0, -1.0), 0.0, 0.0)
    assert gaze.tilt == 0.3
    assert gaze.status is GazeStatus.OUT_OF_REACH
    with pytest.raises(RobotModelError) as nothing_left:
        PanTiltHead(kinectbot, PAN, TILT, "camera_link", tilt_limits=(1e307, 1e308))
    assert len(str(nothing_left.value)) < 150


def continuous_pan(options):
    return head_urdf(**options).replace(
        'type="revolute"><parent link="base"', 'type="continuous"><parent link="base"'
    )


def test_a_continuous_pan_does_not_turn_round_to_a_target_out_of_reach():
    skew = crooked(random.Random(59)) | {"tilt_rpy": "0.64 -0.16 0.55", "limit": 0.5}
    head = PanTiltHead(parse_robot_model(continuous_pan(skew)), PAN, TILT, "camera")
    rnd = random.Random(1)
    for _ in range(30):
        target = [rnd.uniform(-3.0, 3.0) for _ in range(3)]
        first = head.gaze(target, 0.0, 0.0)
        second = head.gaze(target, first.pan, first.tilt)
        assert second.pan == pytest.approx(first.pan, abs=1e-3)


def test_a_continuous_pan_takes_the_short_way_round():
    urdf = continuous_pan({})
    head = (
        HeadParameters(pointing_frame="camera")
        .within((-math.inf, math.inf), (-2.0, 2.0))
        .head(parse_robot_model(urdf))
    )
    for turns in (0, 7):  # it does not end anywhere
        gaze = head.gaze((-3.0, -0.5, 0.5), math.tau * turns + 3.0, 0.0)
        assert gaze.reached
        assert 3.0 < gaze.pan - math.tau * turns < 3.6


SPINNING = head_urdf().replace('name="mount" type="fixed"', 'name="mount" type="continuous"')


@pytest.mark.parametrize(
    ("urdf", "joints", "frame", "axis"),
    [
        (None, ("no_joint", TILT), "camera_link", None),
        (None, (PAN, TILT), "nose", None),
        (None, (PAN, TILT), "head_pan_link", None),
        (None, (PAN, TILT), "pan_tilt_bracket", None),
        (None, (TILT, PAN), "camera_link", None),
        (None, ("camera_link_mount", TILT), "camera_link", None),
        (head_urdf(tilt_axis="0 0 1"), (PAN, TILT), "camera", None),  # parallel
        (SPINNING, (PAN, TILT), "camera", None),  # a joint behind the tilt
        (head_urdf(), (PAN, TILT), "camera", (0.0, 0.0, 0.0)),
        (head_urdf(), (PAN, TILT), "camera", (0.0, 1.0, 0.0)),  # along the tilt axis
    ],
)
def test_a_head_that_cannot_be_is_refused(kinectbot, urdf, joints, frame, axis):
    model = parse_robot_model(urdf) if urdf else kinectbot
    with pytest.raises(RobotModelError):
        PanTiltHead(model, *joints, frame, pointing_axis=axis)


def test_pan_and_tilt_are_two_joints_and_pan_carries_tilt(kinectbot):
    with pytest.raises(RobotModelError, match=f"both '{PAN}'"):
        HeadParameters(head_tilt_joint=PAN).head(kinectbot)
    with pytest.raises(RobotModelError, match="exchange head_pan_joint"):
        HeadParameters(head_pan_joint=TILT, head_tilt_joint=PAN).head(kinectbot)


def test_a_model_with_other_names_is_refused_with_the_parameters_that_name_its_head(kinectbot):
    for wrong in ({"head_pan_joint": "yaw"}, {"pointing_frame": "eye"}, {"camera_link": "eye"}):
        with pytest.raises(RobotModelError, match="set head_pan_joint"):
            HeadParameters(**wrong).head(kinectbot)
    with pytest.raises(RobotModelError) as of_a_goal:  # names another frame, not the head
        HeadParameters().head(kinectbot, "eye")
    assert "head_pan_joint" not in str(of_a_goal.value)
