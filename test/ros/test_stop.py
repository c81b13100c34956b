"""STOP, whatever else happens; and who may move the head."""

import threading
import time

import pytest
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from robot_under_test import wait_for
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64, String
from std_srvs.srv import SetBool

from head_tracking.nodes.head_tracker import HeadTrackerNode

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STILL = 0.012  # rad: a joint that is let go moves on a little


@pytest.fixture
def robot(make_robot):
    return make_robot("--target", "fictitious")


def latched(robot, topic, kind):
    messages = []
    robot.node.create_subscription(kind, topic, messages.append, LATCHED)
    wait_for(lambda: messages)
    return messages


def torque(robot):
    use = robot.simulated.port.use
    return [use(lambda bus, i=i: bus[i].register("Torque Enable")) for i in (1, 2)]


def tracking(robot):
    tracker = robot.composition.nodes["head_tracker"]
    wait_for(lambda: tracker.interface.newest_target and torque(robot) == [1, 1])


def test_stop_relaxes_all_servos_and_says_so_by_joint(robot):
    tracking(robot)
    stopped = latched(robot, "stopped", Bool)
    answer = robot.call("stop")
    assert answer.success
    assert answer.message == "head_pan_joint relaxed, head_tilt_joint relaxed"
    assert torque(robot) == [0, 0]
    wait_for(lambda: stopped[-1].data)
    assert latched(robot, "head_tracker/enabled", Bool)[-1].data is False
    before = robot.at_rest()
    time.sleep(0.5)  # targets keep coming
    assert robot.at_rest() == pytest.approx(before, abs=STILL)


def test_nothing_moves_a_stopped_head_before_resume_not_even_its_torque(robot):
    tracking(robot)
    assert robot.call("stop").success
    before = robot.at_rest()
    assert robot.call("torque_enable", True).success
    robot.forget_log()
    robot.publish("head_pan_controller/command", Float64(data=before[0] + 0.5))
    robot.logged("the head is stopped; call resume")
    assert robot.at_rest() == pytest.approx(before, abs=STILL)


def test_resume_goes_on_slowly_with_what_was_on(robot):
    tracking(robot)
    assert robot.call("stop").success
    robot.at_rest()
    time.sleep(1.0)
    velocities = robot.listen_to_velocity("head_pan_joint")
    answer = robot.call("resume")
    assert answer.success
    assert "/head_tracker goes on, slowly" in answer.message
    tracker = robot.composition.nodes["head_tracker"].interface
    wait_for(lambda: len(velocities) > 20)
    assert max(velocities[:20]) < 0.6
    wait_for(lambda: not tracker.slow, 20.0)  # even if the target runs away from a slow head
    assert not tracker.off


def test_a_resumed_head_is_no_faster_than_a_person_allows(robot):
    tracker = robot.composition.nodes["head_tracker"]
    assert tracker.set_parameters([Parameter("max_joint_speed", value=0.1)])[0].successful
    tracking(robot)
    assert robot.call("stop").success
    goals = robot.goals()
    assert robot.call("resume").success
    wait_for(lambda: len(goals) > 50)
    assert max(goal.speed for told in goals for goal in told.values()) <= 0.1001


def test_a_stop_that_was_resumed_before_a_busy_node_heard_of_it_counts(threads):
    tracker, bus = HeadTrackerNode(), Node("servo_bus")
    stopped = bus.create_publisher(Bool, "stopped", LATCHED)
    wait_for(stopped.get_subscription_count)
    for said in (True, False):
        stopped.publish(Bool(data=said))
        assert stopped.wait_for_all_acked(Duration(seconds=10.0))
    threads.start(tracker)
    threads.start(bus)
    wait_for(lambda: tracker.interface.slow)
    assert stopped.publish(Bool(data=True)) is None
    wait_for(lambda: tracker.interface.off)
    tracker.interface.slow = False
    enable = bus.create_client(SetBool, "head_tracker/enable")
    wait_for(enable.service_is_ready)

    def enabled() -> bool:
        future = enable.call_async(SetBool.Request(data=True))
        return bool(wait_for(lambda: future.done() and future.result()).success)

    wait_for(enabled)  # not yet while it has only just been stopped
    assert tracker.interface.slow


def test_stop_waits_for_no_controller_that_hangs(robot):
    tracking(robot)
    going_on = threading.Event()
    interface = robot.composition.nodes["head_tracker"].interface
    step = interface._turner.step
    interface._turner.step = lambda reading: (going_on.wait(10.0), step(reading))[1]
    time.sleep(0.2)
    asking = threading.Thread(target=lambda: robot.call("stop"))  # whose answer waits, too
    try:
        asking.start()
        wait_for(lambda: torque(robot) == [0, 0], 5.0)
        assert not going_on.is_set()
    finally:
        going_on.set()
        asking.join()
    time.sleep(0.2)
    assert torque(robot) == [0, 0]


def test_stop_waits_for_no_callback_that_hangs(robot):
    tracking(robot)
    going_on = threading.Event()
    robot.composition.nodes["robot_state_publisher"].create_timer(0.01, lambda: going_on.wait(10.0))
    time.sleep(0.1)
    try:
        problems = robot.composition.nodes["servo_bus"].stop()
        assert problems == {"head_pan_joint": "", "head_tilt_joint": ""}
        assert torque(robot) == [0, 0]
    finally:
        going_on.set()


def test_who_turns_the_head_owns_its_joints_and_a_stranger_is_refused(robot):
    owners = latched(robot, "joint_owners", String)
    assert "head_pan_joint: /head_tracker" in owners[-1].data
    robot.forget_log()
    stranger = robot.node.create_publisher(JointState, "joint_commands", 1)
    wait_for(stranger.get_subscription_count)
    stranger.publish(JointState(name=["head_pan_joint"], position=[1.0]))
    robot.logged("head_pan_joint belongs to /head_tracker")


def test_a_node_of_another_process_takes_the_head_over_by_asking(robot):
    owners = latched(robot, "joint_owners", String)
    claim = JointState(name=["head_pan_joint", "head_tilt_joint"])
    claim.header.frame_id = "/other"
    robot.publish("joint_claims", claim)
    wait_for(lambda: "head_pan_joint: /other" in owners[-1].data)
    wait_for(lambda: robot.composition.nodes["head_tracker"].interface.off)
    assert robot.call("head_tracker/enable", True).success
    wait_for(lambda: "head_pan_joint: /head_tracker" in owners[-1].data)
