from pathlib import Path

import pytest

from head_tracking.transforms import RobotModel, load_robot_model

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def kinectbot() -> RobotModel:
    return load_robot_model(ROOT / "urdf" / "kinectbot.urdf.xacro")


@pytest.fixture(scope="session")
def turtlebot() -> RobotModel:
    return load_robot_model(ROOT / "urdf" / "turtlebot.urdf.xacro")


@pytest.fixture(params=["kinectbot", "turtlebot"])
def robot(request: pytest.FixtureRequest) -> RobotModel:
    return request.getfixturevalue(request.param)
