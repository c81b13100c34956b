import signal
from pathlib import Path

import hypothesis
import pytest

from head_tracking.transforms import RobotModel, load_robot_model

# a shell's background jobs ignore it, and so would every program that the tests start
signal.signal(signal.SIGINT, signal.default_int_handler)

# speed is the machine's business, not a test's
hypothesis.settings.register_profile("untimed", deadline=None)
hypothesis.settings.load_profile("untimed")

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
