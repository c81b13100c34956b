"""STOP, whatever else happens; and who may move the head."""

import math
import threading
import time
from pathlib import Path

import pytest
from contract_nodes import JOINTS, BusStandIn
from rclpy.node import Node
from std_msgs.msg import Bool
from waiting import join, wait_for

from head_tracking.control import JointOwners
from head_tracking.head.obstacle import Blocked, Obstacle
from head_tracking.ros.head.head_tracker import HeadTrackerNode
from head_tracking.ros.kit.head_claim import KeptStop
from head_tracking.ros.kit.joint_owners import OwnersOutput, sender_from
from head_tracking.ros.kit.spinning import NodeDied
from head_tracking.ros.kit.threads import take_message
from head_tracking.ros.kit.topics import LATCHED, LONGEST_NAME


@pytest.fixture
def robot(make_robot):
    return make_robot("--target", "fictitious")


def torque(robot):
    use = robot.simulated.use
    return [use(lambda bus, i=i: bus[i].register("Torque Enable")) for i in (1, 2)]


def tracking(robot):
    tracker = robot.composition.nodes["head_tracker"]
    wait_for(lambda: tracker.control.frames.target and torque(robot) == [1, 1])


def test_a_stop_and_resume_that_a_node_missed_make_it_cautious(start):
    bus = BusStandIn()
    bus.own("", True, 1)
    bus.own("", False, 1)
    tracker, _ = start(HeadTrackerNode()), start(bus)
    wait_for(lambda: tracker.control.is_cautious)
    assert not tracker.control.off


def test_no_state_of_before_a_stop_is_published_after_it(threads):
    """Another thread stops the head while the owners of its joints are published."""

    class Owners(JointOwners):
        def of(self, joints):
            return Found(super().of(joints))

    class Found(dict):
        def items(self):  # after `stopped` was read
            if stopping.ident is None and output:
                stopping.start()
                stopping.join(0.2)
            return super().items()

    owners, node, heard, output = Owners(), Node("bus"), [], []
    stopping = threading.Thread(target=owners.stop, args=[dict])
    node.create_subscription(Bool, "stopped", lambda message: heard.append(message.data), 10)
    threads.start(node)
    output.append(OwnersOutput(node, owners, ["pan"]))
    wait_for(lambda: heard == [False])
    owners.claim("/head_tracker", ["pan"])
    stopping.join()
    wait_for(lambda: True in heard)
    time.sleep(0.1)
    assert heard == [False, True]


def test_another_owner_that_gets_the_joints_back_at_a_resume_has_them(start):
    """It took over so shortly before the STOP that the tracker had not heard of it."""
    tracker, bus = start(HeadTrackerNode()), start(BusStandIn())
    bus.own("", True, 1)
    wait_for(lambda: tracker.control.is_cautious)
    bus.own("/other", False, 1)
    wait_for(lambda: tracker.control.off == Obstacle(Blocked.OWNED, "/other"))
    tracker.control.disable(Blocked.DISABLED, "tracking")
    assert tracker.control.off == Obstacle(Blocked.DISABLED, "tracking")
    tracker.control.enable()
    assert not tracker.control.off
    wait_for(lambda: bus.claims)


def test_the_limits_of_a_bus_elsewhere_are_those_of_the_head(start):
    tracker, bus = start(HeadTrackerNode()), start(Node("servo_bus"))
    known = {JOINTS[0]: (-0.3, 0.3), JOINTS[1]: (math.nan, 1.0)}
    OwnersOutput(bus, JointOwners(), JOINTS, known.__getitem__)
    limits = tracker.control._loop.backend.limits
    wait_for(lambda: limits(JOINTS[0]) == known[JOINTS[0]])
    assert limits(JOINTS[1]) == (-math.inf, math.inf)


def test_a_restarted_bus_without_short_names_is_stopped_again(start):
    tracker, bus = start(HeadTrackerNode()), start(BusStandIn(offers=("~/stop",)))
    bus.own("", True, 1)
    wait_for(lambda: tracker.control.off == Obstacle(Blocked.STOPPED))
    bus.own("", False, 0)
    wait_for(lambda: bus.calls == ["~/stop"])
    bus.own("", True, 1)


def test_a_sender_that_names_no_epoch_is_a_name():
    for epoch in ("", "9" * 5000, "one"):
        assert sender_from(f"somebody#{epoch}") == (f"somebody#{epoch}"[:LONGEST_NAME], None)
    for name in ("somebody", "x" * 999):
        assert sender_from(f"{name}#7") == (name[:LONGEST_NAME], 7)


def test_stop_waits_for_no_controller_that_hangs(robot):
    tracking(robot)
    going_on = threading.Event()
    targets = robot.composition.nodes["head_tracker"].control.targets
    update = targets.update
    targets.update = lambda *given: (going_on.wait(60.0), update(*given))[1]
    time.sleep(0.2)
    asking = threading.Thread(target=lambda: robot.call("stop"))  # whose answer waits, too
    try:
        asking.start()
        wait_for(lambda: torque(robot) == [0, 0], 50.0)
        assert not going_on.is_set()
    finally:
        going_on.set()
        join(asking)
    time.sleep(0.2)
    assert torque(robot) == [0, 0]


def test_stop_waits_for_no_callback_that_hangs(robot):
    tracking(robot)
    going_on = threading.Event()
    robot.composition.nodes["robot_state_publisher"].create_timer(0.01, lambda: going_on.wait(60.0))
    time.sleep(0.1)
    try:
        problems = robot.composition.loop.stop()
        assert problems == {"head_pan_joint": "", "head_tilt_joint": ""}
        assert torque(robot) == [0, 0]
    finally:
        going_on.set()


def test_a_failing_controller_does_not_prevent_the_stop_message(robot):
    tracking(robot)
    tracker = robot.composition.nodes["head_tracker"]
    listener = Node("listener")  # not of the thread that spins the others, which may end
    subscription = listener.create_subscription(Bool, "stopped", lambda _: None, LATCHED)

    def is_published():
        taken = take_message(subscription)
        return taken is not None and taken[0].data

    tracker.control.targets.restart = lambda *_: 1 // 0
    answer = robot.composition.loop.stop()
    assert answer == {"head_pan_joint": "", "head_tilt_joint": ""}
    assert any(is_published() or time.sleep(0.01) for _ in range(1000))
    listener.destroy_node()
    with pytest.raises(NodeDied):  # (by the loop, or by the node, whichever notices the STOP first)
        wait_for(lambda: False)


def test_a_stop_in_the_middle_of_a_resume_is_kept_over_a_crash(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    owners, unlink, threads = JointOwners(), Path.unlink, []
    KeptStop(()).guard(owners)
    owners.stop(dict)

    def unlink_late(*arguments, **options):
        threads.append(threading.Thread(target=owners.stop, args=[dict]))
        threads[0].start()
        threads[0].join(0.1)
        unlink(*arguments, **options)

    monkeypatch.setattr(Path, "unlink", unlink_late)
    owners.resume()
    join(*threads)
    restarted = JointOwners()
    KeptStop(()).guard(restarted)
    assert owners.stopped and restarted.stopped
