"""Two heads in one graph, each a run in a namespace of its own: nothing mixes."""

import signal

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rig import JOINTS
from waiting import repeating, wait_for


class Head:
    """A simulated run in a namespace, and who talks to it."""

    def __init__(self, bench, name):
        self.name = name
        self.program = bench.start(
            "head_tracking", "--sim", "--target", "none", "--ros-args", "-r", f"__ns:=/{name}"
        )
        self.person = bench.meet(f"/{name}")
        self.target = (2.0, 0.0)

    def publish(self):
        self.person.look_at(*self.target, 1.0)

    @property
    def pan(self):
        return self.person.pan

    def at_rest(self):
        """The pan once it has not changed for twenty joint states."""
        seen = []

        def still():
            seen.append(self.pan)
            return len(seen) > 30 and max(seen[-30:]) - min(seen[-30:]) < 0.005

        wait_for(still)
        return self.pan


@pytest.fixture
def heads(bench):
    found = [Head(bench, name) for name in ("left", "right")]
    for head in found:
        head.person.wait_for_joints()
    with repeating(*(head.publish for head in found), period=0.05):
        yield found


def test_two_heads_are_independent(heads):
    left, right = heads
    diagnostics = left.person.hear("/diagnostics", DiagnosticArray)

    # commands
    left.target, right.target = (2.0, 1.0), (2.0, -1.0)
    wait_for(lambda: left.pan > 0.3 and right.pan < -0.3)

    # owners
    for head in heads:
        assert set(head.person.owners.values()) == {f"/{head.name}/head_tracker"}
    assert left.person.call("head_tracker/enable", False).success
    wait_for(lambda: set(left.person.owners.values()) == {""})
    assert set(right.person.owners.values()) == {"/right/head_tracker"}

    # one rests, the other goes on
    rest = left.at_rest()
    left.target, right.target = (2.0, -1.0), (2.0, 1.0)
    wait_for(lambda: right.pan > 0.3)
    assert left.pan == pytest.approx(rest, abs=0.05)

    # STOP
    assert left.person.call("head_tracker/enable", True).success
    wait_for(lambda: left.pan < -0.3)
    assert left.person.call("stop").success
    wait_for(lambda: left.person.stopped)
    left.target, right.target = (2.0, 1.0), (2.0, -1.0)
    wait_for(lambda: right.pan < -0.3)
    assert left.pan < -0.3
    assert not right.person.stopped

    # diagnostics
    def told():
        return {status.name for message in list(diagnostics) for status in message.status}

    for head in heads:
        joints = {f"{head.name}/servo_bus: {joint}" for joint in JOINTS}
        wait_for(lambda: joints <= told())  # noqa: B023
    assert all(name.startswith(("left/", "right/")) for name in told())

    # the end of one
    assert left.program.end(signal.SIGINT) == 0
    right.target = (2.0, 1.0)
    wait_for(lambda: right.pan > 0.3)
