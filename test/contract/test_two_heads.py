"""Two heads in one graph, each a run in a namespace of its own: nothing mixes."""

import signal

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rig import JOINTS
from waiting import repeating, wait_for


@pytest.fixture
def heads(bench):
    """A person and a program for each."""
    found = []
    for name in ("left", "right"):
        words = ("--sim", "--target", "none", "--ros-args", "-r", f"__ns:=/{name}")
        found.append((bench.meet(f"/{name}"), bench.start("head_tracking", *words)))
    for person, _ in found:
        person.wait_for_joints()
    return found


def test_two_heads_are_independent(heads):
    (left, program), (right, _) = heads
    diagnostics = left.hear("/diagnostics", DiagnosticArray)
    sides = {left: 1.0, right: -1.0}

    def publish():
        for person, side in sides.items():
            person.look_at(2.0, side, 1.0)

    def told():
        return {status.name for message in list(diagnostics) for status in message.status}

    with repeating(publish, period=0.05):
        wait_for(lambda: left.pan > 0.3 and right.pan < -0.3)
        for person, side in ((left, "left"), (right, "right")):
            owners = {f"/{side}/head_tracker"}
            wait_for(lambda p=person, o=owners: set(p.owners.values()) == o)
        left.until_done("stop")
        wait_for(lambda: left.stopped)
        sides.update({left: -1.0, right: 1.0})
        wait_for(lambda: right.pan > 0.3)
        assert left.pan > 0.3
        assert not right.stopped
        names = {f"{name}/servo_bus: {joint}" for name in ("left", "right") for joint in JOINTS}
        wait_for(lambda: names <= told())
        assert all(name.startswith(("left/", "right/")) for name in told())
        assert program.end(signal.SIGINT) == 0
        sides[right] = -1.0
        wait_for(lambda: right.pan < -0.3)
