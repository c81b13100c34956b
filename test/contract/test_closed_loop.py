"""How well a simulated head follows, in figures that a broken head misses and a busy machine meets.

How good it is at its best is measured by scripts/benchmark, in simulated time.
"""

import re
import statistics

import pytest
from rig import DEGREE
from std_msgs.msg import Float64
from waiting import wait_for

BUSY = 8 * DEGREE  # of a quiet machine: 1; with the tutorials' law: 35


@pytest.mark.parametrize(
    ("robot", "target"), [("kinectbot", "smooth"), ("turtlebot", "fictitious")]
)
def test_the_head_follows_a_moving_target(bench, robot, target):
    run = bench.start("head_tracking", "--sim", "--robot", robot, "--target", target)
    person = bench.person
    person.wait_for_joints()
    errors = person.hear("head_tracker/tracking_error", Float64)
    pans = set()

    def follows():
        pans.add(round(person.pan, 1))
        latest = [error.data for error in errors[-150:]]
        return len(latest) == 150 and len(pans) > 8 and statistics.median(latest) < BUSY

    wait_for(follows)
    if robot == "turtlebot":  # nobody measures its wheels; the configuration says where they are
        assert person.measured["left_wheel_joint"][1] == 0.0
    assert run.end(2) == 0, run.output
    told = re.search(r"([\d.]+)° rms, ([\d.]+)° max .* (\d+) bus cycles", run.last_line)
    assert told is not None, run.last_line
    rms, most, cycles = map(float, told.groups())
    assert 0.0 < rms <= most
    assert cycles > 100


def test_a_point_on_the_command_line_is_looked_at_without_a_discovery_server(bench):
    """Other machines would hear a simulated run there, and follow its target."""
    server = {"ROS_DISCOVERY_SERVER": "127.0.0.1:11811"}
    words = ("--sim", "--mode", "point", "--target", "-0.5,0.8,0.4@base_link")
    run = bench.start("head_tracking", *words, environment=server)
    wait_for(lambda: bench.person.state("point_head") == "arrived")
    bench.person.wait_for_joints()
    assert bench.person.pan == pytest.approx(2.14, abs=0.05)
    assert run.end(2) == 0, run.output
