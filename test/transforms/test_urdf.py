import numpy as np
import pytest

from head_tracking.transforms import (
    RobotModelError,
    Transform,
    load_robot_model,
    parse_robot_model,
    with_fixed_root,
)

TWO_LINKS = '<link name="a"/><link name="b"/>'
JOINT = '<joint name="j" type="{type}"><parent link="{parent}"/><child link="b"/>{more}</joint>'
LIMIT = '<limit lower="-1" upper="1"/>'


def robot(*parts: str) -> str:
    return '<robot name="r">' + "".join(parts) + "</robot>"


def joint(type: str = "revolute", parent: str = "a", more: str = LIMIT) -> str:
    return JOINT.format(type=type, parent=parent, more=more)


@pytest.mark.parametrize(
    ("urdf", "words"),
    [
        ("<robot", "not well-formed"),
        ('<robot name="r"><link name="a">', "not well-formed"),
        ("", "not well-formed"),
        ("<sdf/>", "<sdf>"),
        ('<robot><link name="a"/></robot>', "'name'"),
        (robot(), "no links"),
        (robot("<link/>"), "<link> number 1"),
        (robot(TWO_LINKS), "2 root links"),
        (robot('<link name="a"/><link name="a"/>'), "two links named 'a'"),
        (robot(TWO_LINKS, joint(), joint()), "two joints named 'j'"),
        (robot(TWO_LINKS, joint(parent="z")), "parent link 'z'"),
        (robot(TWO_LINKS, joint(), joint().replace('"j"', '"k"')), "two joints, 'j' and 'k'"),
        (robot(TWO_LINKS, joint(parent="b")), "circle"),
        (robot(TWO_LINKS, joint(type="ball")), "'ball'; allowed are fixed"),
        (robot(TWO_LINKS, joint(type="")), "'type'"),
        (robot(TWO_LINKS, '<joint name="j" type="fixed"><child link="b"/></joint>'), "<parent>"),
        (robot(TWO_LINKS, joint(more="")), "no <limit>"),
        (robot(TWO_LINKS, joint(more='<limit lower="1" upper="-1"/>')), "below upper"),
        (robot(TWO_LINKS, joint(more='<limit lower="nan" upper="1"/>')), "limit lower.*finite"),
        (robot(TWO_LINKS, joint(more=LIMIT + '<axis xyz="0 0 0"/>')), "zero <axis>"),
        (robot(TWO_LINKS, joint(more=LIMIT + '<axis xyz="0 1"/>')), "3 finite numbers"),
        (robot(TWO_LINKS, joint(more=LIMIT + '<origin rpy="a b c"/>')), "origin rpy"),
        (robot(TWO_LINKS, joint(more=LIMIT + '<mimic joint="k"/>')), "'k', which is not in"),
        (robot(TWO_LINKS, joint(more=LIMIT + '<mimic joint="j"/>')), "in a circle"),
        (robot('<link name="a"><visual><geometry><box size="x"/></geometry></visual></link>'),
         "yourdfpy cannot read"),
    ],
)  # fmt: skip
def test_a_bad_model_is_refused_and_the_error_says_why(urdf, words):
    with pytest.raises(RobotModelError, match=words):
        parse_robot_model(urdf)


def test_a_circle_beside_a_good_tree_is_found():
    urdf = robot(
        '<link name="root"/>', TWO_LINKS, joint(),
        '<joint name="k" type="fixed"><parent link="b"/><child link="a"/></joint>',
    )  # fmt: skip
    with pytest.raises(RobotModelError, match="a, b are connected in a circle"):
        parse_robot_model(urdf)


def test_left_out_origin_axis_and_limits_are_what_urdf_says():
    model = parse_robot_model(robot(TWO_LINKS, joint(type="continuous", more="")))
    assert model.joints["j"].axis == (1, 0, 0)
    assert model.joints["j"].origin == Transform.identity()
    assert model.joints["j"].limits.upper == float("inf")


def test_an_axis_is_normalised():
    model = parse_robot_model(
        robot(TWO_LINKS, joint(type="prismatic", more=LIMIT + '<axis xyz="0 3 4"/>'))
    )
    assert model.joints["j"].axis == pytest.approx((0, 0.6, 0.8))
    assert model.transform("a", "b", {"j": 1.0}).translation == pytest.approx((0, 0.6, 0.8))


def test_a_missing_file_and_a_broken_xacro_name_the_file(tmp_path):
    with pytest.raises(RobotModelError, match=r"nothing\.urdf"):
        load_robot_model(tmp_path / "nothing.urdf")
    broken = tmp_path / "broken.urdf.xacro"
    broken.write_text('<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
                      "<xacro:undefined/></robot>")  # fmt: skip
    with pytest.raises(RobotModelError, match=r"broken\.urdf\.xacro.*xacro"):
        load_robot_model(broken)


def test_a_model_can_be_put_into_the_world(kinectbot):
    T_world_base = Transform.from_xyz_rpy((0, 0, 0.0325), (0, 0, 0.4))
    model = with_fixed_root(kinectbot, "world", T_world_base)
    assert model.root == "world"
    assert model.children("world") == ("base_link",)
    found = model.transform("world", "base_link", {})
    assert np.allclose(found.as_matrix(), T_world_base.as_matrix(), atol=1e-12)
    assert parse_robot_model(model.urdf).links == model.links


def test_a_second_world_is_refused(kinectbot):
    with pytest.raises(RobotModelError, match="two links named 'torso_link'"):
        with_fixed_root(kinectbot, "torso_link", Transform.identity())
