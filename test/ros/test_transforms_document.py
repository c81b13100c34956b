"""The programs in docs/explain/transforms.md work as they stand there."""

import re
from pathlib import Path

from head_tracking.share import robot_file

DOCUMENT = Path(__file__).parents[2] / "docs" / "explain" / "transforms.md"
FOR_ROS, WITHOUT_ROS = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(), re.DOTALL)


def test_the_program_for_tf2_ros(pointing_robot):
    names = {"__name__": "document"}
    exec(FOR_ROS, names)
    pointing_robot.threads.start(names["CameraHeight"]())
    height, x, y = map(
        float, re.findall(r"-?[\d.]+", pointing_robot.logged("m high, looking at"))[:3]
    )
    assert 0.5 < height < 1.5
    assert x > 0.9
    assert abs(y) < 0.1


def test_the_program_without_ros():
    names: dict = {}
    exec(WITHOUT_ROS.replace("urdf/kinectbot.urdf.xacro", str(robot_file("kinectbot"))), names)
    assert names["x"] > 0.9
    assert 0.1 < names["y"] < 0.3
