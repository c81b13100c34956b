from pathlib import Path

import pytest

from head_tracking.share import robot_file, share_directory


def test_the_share_directory_holds_models_and_configuration():
    assert (share_directory() / "urdf" / "kinectbot.urdf.xacro").is_file()
    assert (share_directory() / "config" / "kinectbot.yaml").is_file()


def test_a_robot_is_found_by_name_and_by_path():
    by_name = robot_file("turtlebot")
    assert robot_file(str(by_name)) == by_name


def test_an_unknown_robot_is_an_error_that_lists_those_known():
    with pytest.raises(FileNotFoundError, match=r"'r2d2'.*kinectbot.*turtlebot"):
        robot_file("r2d2")


def test_parts_of_models_are_not_robots():
    assert not list(Path(share_directory() / "urdf").glob("shapes.urdf*"))
