import faulthandler
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import hypothesis
import pytest
from browser import NoBrowser, open_browser

from head_tracking.gaze import PanTiltHead
from head_tracking.transforms import RobotModel, load_robot_model

# a shell's background jobs and nohup ignore them, and so would every program that the tests start
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)

# or every program that the tests start compiles the package anew
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# speed is the machine's business, not a test's
hypothesis.settings.register_profile("untimed", deadline=None)
hypothesis.settings.load_profile("untimed")

ROOT = Path(__file__).parents[1]

SLOW = {
    "contract", "test_packaging.py", "test_document_code.py", "test_reference.py",
    "test_viewer.py", "test_programs.py",
}  # fmt: skip
"""Folders and files whose tests start programs or a browser."""

HANGS = 300.0  # s that a test never takes

_output: list[int] = []


def pytest_configure(config: pytest.Config) -> None:
    capture = config.pluginmanager.getplugin("capturemanager")
    with capture.global_and_fixture_disabled():
        _output.append(os.dup(2))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if SLOW & {*item.path.parts}:
            item.add_marker(pytest.mark.slow)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """End a process that hangs in a test, with the stacks of its threads; xdist names the test.

    Not pytest-timeout: it needs the interpreter, for which a test may wait for ever.
    """
    if "HEAD_TRACKING_HOURS" not in os.environ:  # some tests take as long as they are told
        faulthandler.dump_traceback_later(HANGS, exit=True, file=_output[0])
    yield
    faulthandler.cancel_dump_traceback_later()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    try:
        with open_browser() as opened:
            yield opened
    except NoBrowser as missing:
        pytest.skip(str(missing))


@pytest.fixture(scope="session")
def kinectbot() -> RobotModel:
    return load_robot_model(ROOT / "urdf" / "kinectbot.urdf.xacro")


@pytest.fixture(scope="session")
def turtlebot() -> RobotModel:
    return load_robot_model(ROOT / "urdf" / "turtlebot.urdf.xacro")


@pytest.fixture(scope="session")
def head(kinectbot: RobotModel) -> PanTiltHead:
    return PanTiltHead(
        kinectbot, "head_pan_joint", "head_tilt_joint", "camera_link", tilt_limits=(-1.08, 1.47)
    )


@pytest.fixture(params=["kinectbot", "turtlebot"])
def robot(request: pytest.FixtureRequest) -> RobotModel:
    return request.getfixturevalue(request.param)
