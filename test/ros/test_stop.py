"""STOP, whatever else happens; and who may move the head."""

import threading
import time

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, PointStamped
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from robot_under_test import wait_for
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64, String
from std_srvs.srv import SetBool

from head_tracking.control import JointOwners
from head_tracking.nodes.head_tracker import HeadTrackerNode
from head_tracking.ros.joint_owners import control_message

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
JOINTS = ("head_pan_joint", "head_tilt_joint")
STILL = 0.012  # rad: a joint that is let go moves on a little


@pytest.fixture
def robot(make_robot):
    return make_robot("--target", "fictitious")


def latched(robot, topic, kind):
    messages = []
    robot.node.create_subscription(kind, topic, messages.append, LATCHED)
    wait_for(lambda: messages)
    return messages


def point(x, y, z, frame):
    message = PointStamped(point=Point(x=x, y=y, z=z))
    message.header.frame_id = frame
    return message


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


SERVICES = [
    ("torque_enable", True),
    ("head_pan_controller/torque_enable", True),
    ("head_tilt_controller/torque_enable", True),
    ("head_tracker/enable", True),
    ("head_tracker/recenter", None),
    ("recover", None),
    ("head_pan_controller/recover", None),
    ("head_pan_controller/start", None),
    ("head_pan_controller/restart", None),
    ("servo_bus/write_eeprom", None),
]


def test_a_stopped_head_refuses_every_service_but_resume(robot):
    tracking(robot)
    assert robot.call("stop").success
    goals = robot.goals()
    answers = [robot.call(name, data) for name, data in SERVICES]
    assert [answer.success for answer in answers] == [False] * len(SERVICES)
    assert len({answer.message for answer in answers}) == 1  # the same sentence
    assert torque(robot) == [0, 0]
    assert not goals
    assert latched(robot, "stopped", Bool)[-1].data


def test_what_takes_torque_away_is_done_while_stopped_and_changes_nothing_for_later(robot):
    tracking(robot)
    assert robot.call("stop").success
    assert robot.call("relax").success
    assert robot.call("torque_enable", False).success
    assert robot.call("stop").success
    assert torque(robot) == [0, 0]
    assert robot.call("resume").success
    wait_for(lambda: torque(robot) == [1, 1])


def test_no_topic_moves_a_stopped_head(robot):
    tracking(robot)
    assert robot.call("stop").success
    before = robot.at_rest()
    commands = JointState(name=["head_pan_joint"], position=[before[0] + 0.5])
    claim = JointState(name=["head_pan_joint", "head_tilt_joint"])
    commands.header.frame_id = claim.header.frame_id = "/other"
    for _ in range(3):
        for topic, message in (
            ("joint_claims", claim),
            ("joint_commands", commands),
            ("head_pan_controller/command", Float64(data=before[0] + 0.5)),
            ("target_point", point(1.0, -1.0, 0.5, "base_link")),
        ):
            publisher = robot.node.create_publisher(type(message), topic, 10)
            wait_for(publisher.get_subscription_count)
            publisher.publish(message)
            time.sleep(0.1)
    assert torque(robot) == [0, 0]
    assert latched(robot, "joint_owners", String)[-1].data.count(": /") == 0
    assert robot.at_rest() == pytest.approx(before, abs=STILL)


def test_a_supervisor_that_enables_everything_again_and_again_undoes_no_stop(robot):
    tracking(robot)
    ended = threading.Event()

    def supervise() -> None:
        while not ended.is_set():
            for name in ("head_tracker/enable", "torque_enable"):
                robot.call(name, True)
            ended.wait(0.05)

    supervisor = threading.Thread(target=supervise)
    supervisor.start()
    try:
        time.sleep(0.5)
        assert robot.call("stop").success
        where, ends = robot.at_rest(0.1), time.monotonic() + 2.0
        while time.monotonic() < ends:
            assert torque(robot) == [0, 0]
            time.sleep(0.01)
        assert robot.at_rest(0.1) == pytest.approx(where, abs=STILL)
        assert robot.call("resume").success
        wait_for(lambda: torque(robot) == [1, 1])
    finally:
        ended.set()
        supervisor.join()


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


class ElsewhereBus:
    """What a servo bus of another process says, and what it hears."""

    def __init__(self):
        self.node = Node("servo_bus")
        self._control = self.node.create_publisher(DiagnosticStatus, "joint_control", LATCHED)
        self.claims, self.commands = [], []
        self.node.create_subscription(JointState, "joint_claims", self.claims.append, 10)
        self.node.create_subscription(JointState, "joint_commands", self.commands.append, 10)
        wait_for(self._control.get_subscription_count)

    def say(self, stopped: bool, epoch: int) -> None:
        owners = JointOwners()
        owners.follow(stopped, epoch)
        self._control.publish(control_message(owners, JOINTS))
        assert self._control.wait_for_all_acked(Duration(seconds=10.0))


def test_a_stop_that_was_resumed_before_a_busy_node_heard_of_it_counts(threads):
    tracker = HeadTrackerNode()
    bus = ElsewhereBus()
    bus.say(True, 1)
    bus.say(False, 1)
    threads.start(tracker)
    threads.start(bus.node)
    wait_for(lambda: tracker.interface.slow)
    assert not tracker.interface.off


def test_a_node_of_another_process_is_stopped_until_the_bus_resumes(threads):
    tracker = HeadTrackerNode()
    bus = ElsewhereBus()
    threads.start(tracker)
    threads.start(bus.node)
    enabled = []
    bus.node.create_subscription(
        Bool, "head_tracker/enabled", lambda message: enabled.append(message.data), LATCHED
    )
    wait_for(lambda: enabled == [True])
    bus.say(True, 7)
    wait_for(lambda: enabled == [True, False])
    enable = bus.node.create_client(SetBool, "head_tracker/enable")
    wait_for(enable.service_is_ready)
    for _ in range(10):
        future = enable.call_async(SetBool.Request(data=True))
        wait_for(future.done)
        assert not future.result().success
    bus.say(False, 7)
    wait_for(lambda: enabled == [True, False, True])
    assert tracker.interface.slow
    assert not bus.claims


def test_what_another_process_sent_before_a_stop_does_nothing_after_it(robot):
    """With the epoch of before, as a message that was long on its way."""
    tracking(robot)
    assert robot.call("head_tracker/enable", False).success
    old = robot.composition.loop.owners.epoch.value
    assert robot.call("stop").success
    assert robot.call("resume").success
    where = robot.at_rest()
    command = JointState(name=["head_pan_joint"], position=[where[0] + 0.5])
    command.header.frame_id = f"/elsewhere#{old}"
    robot.forget_log()
    commands = robot.node.create_publisher(JointState, "joint_commands", 1)
    wait_for(commands.get_subscription_count)
    commands.publish(command)
    robot.logged("joint_commands of /elsewhere refused")
    assert robot.at_rest() == pytest.approx(where, abs=STILL)
    command.header.frame_id = f"/elsewhere#{robot.composition.loop.owners.epoch.value}"
    commands.publish(command)
    wait_for(lambda: abs(robot.pan - where[0]) > 0.4)


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


@pytest.mark.parametrize("short", [True, False])
def test_services_of_the_bus_are_private_and_short_names_can_be_left_out(make_robot, short):
    robot = make_robot("--target", "none", ros_args=["-p", f"servo_bus:short_names:={short}"])
    assert robot.call("servo_bus/torque_enable", True).success
    assert torque(robot) == [1, 1]
    assert robot.call("servo_bus/stop").success
    assert torque(robot) == [0, 0]
    assert not robot.call("servo_bus/recover").success
    assert robot.call("servo_bus/relax").success
    assert robot.call("servo_bus/resume").success
    names = {name for name, _ in robot.node.get_service_names_and_types()}
    for name in ("stop", "resume", "relax", "recover", "torque_enable"):
        assert (f"/{name}" in names) is short


def test_who_loses_one_joint_gives_the_other_up_too(robot):
    tracking(robot)
    owners = latched(robot, "joint_owners", String)
    claim = JointState(name=["head_tilt_joint"])
    claim.header.frame_id = "/other"
    robot.publish("joint_claims", claim)
    wait_for(lambda: owners[-1].data == "head_pan_joint: \nhead_tilt_joint: /other")
    enabled = latched(robot, "head_tracker/enabled", Bool)
    wait_for(lambda: not enabled[-1].data)


def test_a_controller_that_fails_keeps_nobody_from_hearing_of_a_stop(robot):
    tracking(robot)
    tracker = robot.composition.nodes["head_tracker"]
    tracker.interface._turner.switched = lambda: 1 // 0
    answer = robot.composition.nodes["servo_bus"].stop()
    assert answer == {"head_pan_joint": "", "head_tilt_joint": ""}
    assert latched(robot, "stopped", Bool)[-1].data
    assert isinstance(tracker.failure, ZeroDivisionError)
