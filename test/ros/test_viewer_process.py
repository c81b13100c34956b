"""The viewer beside a run, as a process: it ends with the run, and is told all that the run was."""

import os
import signal
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from robot_under_test import wait_for

pytestmark = pytest.mark.skipif(
    find_spec("viser") is None,
    reason="viser is missing: pip install -r requirements/viewer.txt",
)
PATIENCE = 60.0
RUN = """
import sys, time
from head_tracking.viewer_process import viewer_process
with viewer_process(sys.argv[1:]):
    time.sleep(600)
"""


def children(pid: int) -> list[int]:
    found = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [int(child) for child in found]


def is_there(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.fixture
def run(tmp_path):
    arguments = ["--ros-args", "-r", "__ns:=/left", "-p", "port:=0", "-p", "rate:=7.0"]
    log = tmp_path / "log"
    with log.open("w") as output:
        process = subprocess.Popen(
            [sys.executable, "-c", RUN, *arguments],
            stdout=output,
            stderr=output,
            env={**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
        )
    try:
        yield process, log
    finally:
        process.kill()
        process.wait()


def test_a_killed_run_leaves_no_viewer_behind_and_all_ros_arguments_reach_it(run):
    process, log = run
    wait_for(lambda: "the robot is at http" in log.read_text(), PATIENCE)
    assert "[left.viewer]" in log.read_text()
    (viewer,) = children(process.pid)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    wait_for(lambda: not is_there(viewer), PATIENCE)


def test_a_run_that_ends_at_once_ends_a_viewer_that_still_starts(run):
    process, _ = run
    wait_for(lambda: children(process.pid), PATIENCE)
    (viewer,) = children(process.pid)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    wait_for(lambda: not is_there(viewer), PATIENCE)
