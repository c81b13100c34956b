"""What a person asks of a run, and what a robot has already and keeps."""

from pathlib import Path

import pytest

from head_tracking.runner import parse_arguments

ALL = {"servo_bus", "robot_state_publisher", "joint_state_publisher", "head_tracker"}


@pytest.mark.parametrize(
    ("names", "left_out"),
    [
        ([], set()),
        (["head"], {"head_tracker"}),
        (["joint_state_publisher"], {"joint_state_publisher"}),
        (
            ["robot_state_publisher", "joint_state_publisher"],
            {"robot_state_publisher", "joint_state_publisher"},
        ),
    ],
)
def test_a_run_can_do_without_what_the_robot_has(names, left_out):
    words = [word for name in names for word in ("--without", name)]
    plan = parse_arguments(["--sim", "--target", "none", *words])
    assert {node.name for node in plan.nodes} == ALL - left_out
    assert plan.head_node == ("" if "head" in names else "head_tracker")


def test_what_can_not_be_left_out_is_said(capsys):
    with pytest.raises(SystemExit):
        parse_arguments(["--without", "servo_bus"])
    assert "joint_state_publisher" in capsys.readouterr().err


def frames(make_robot, *arguments: str, ros_args: list[str] | None = None) -> set[str]:
    robot = make_robot("--target", "none", *arguments, ros_args=ros_args)
    return set(robot.composition.buffer.core.frames())


def test_a_robot_of_the_demonstration_stands_in_the_world(make_robot):
    assert "world" in frames(make_robot, "--robot", "turtlebot")


def test_a_robot_of_ones_own_has_one_parent_only(make_robot, kinectbot, tmp_path: Path):
    """Its odometry says where base_link is."""
    own = tmp_path / "mine.urdf"
    own.write_text(kinectbot.urdf)
    assert "world" not in frames(make_robot, "--robot", str(own))


def test_a_robot_of_ones_own_stands_in_a_world_if_it_is_given(
    make_robot, kinectbot, tmp_path: Path
):
    own = tmp_path / "mine.urdf"
    own.write_text(kinectbot.urdf)
    given = ["-p", "robot_state_publisher:world_frame:=map"]
    assert "map" in frames(make_robot, "--robot", str(own), ros_args=given)


def test_a_smooth_target_is_there_beside_the_tutorials():
    def path(target: str) -> object:
        (node,) = (
            node
            for node in parse_arguments(["--sim", "--target", target]).nodes
            if node.name == "fictitious_target"
        )
        return node.parameters.get("path", "tutorial")

    assert path("fictitious") == "tutorial"
    assert path("smooth") == "harmonic"


def test_a_point_with_a_minus_can_be_the_target():
    nodes = parse_arguments(["--sim", "--target", "-1,0.5,0@base_link"]).nodes
    (target,) = (node for node in nodes if node.name == "fictitious_target")
    assert target.parameters["center"] == [-1.0, 0.5, 0.0]
