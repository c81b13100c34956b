"""STOP relaxes everything, whoever runs the head, and only `resume` ends it."""

import math
import threading
import time
from contextlib import closing, contextmanager

import pytest
from rig import DEGREE, JOINTS, Bench
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64
from waiting import wait_for

STILL = 0.015  # rad: a joint that is relaxed moves on a little
SLOW = 0.6  # rad/s
NODES = ("joint_state_publisher", "robot_state_publisher", "head_tracker")


def swing(seconds):
    bearing = 0.8 * math.sin(1.5 * seconds)
    return 2 * math.cos(bearing), 2 * math.sin(bearing), 0.5


@pytest.fixture(scope="module", params=["one process", "a process for each node"])
def running(request, tmp_path_factory):
    """A head that follows a target which somebody keeps publishing."""
    with closing(Bench(tmp_path_factory.mktemp("bench"))) as bench:
        if request.param == "one process":
            bench.run("--target", "none")
        else:
            port = ("-p", f"port_name:={bench.servos.name}", "-p", "reply_timeout:=0.1")
            bench.start("servo_bus", "--ros-args", *port)
            for name in NODES:
                bench.start(name)
        bench.person.wait_for_joints()
        with published(bench.person):
            yield bench


@contextmanager
def published(person):
    """A target that swings."""
    ending = threading.Event()

    def publish():
        while not ending.wait(0.03):
            person.look_at(*swing(time.monotonic()))

    thread = threading.Thread(target=publish)
    thread.start()
    yield
    ending.set()
    thread.join()


@pytest.fixture
def bench(running):
    """The head follows."""
    person = running.person
    assert person.call("resume").success
    assert person.call("torque_enable", True).success
    wait_for(lambda: person.call("head_tracker/enable", True).success)
    wait_for(lambda: person.state("head_tracker") == "tracking")
    assert running.servos.torque == [1, 1]
    person.log.clear()
    return running


@pytest.fixture
def person(bench):
    return bench.person


def test_stop_relaxes_the_servos_and_everybody_hears_of_it(bench, person):
    assert not person.stopped
    answer = person.call("stop")
    assert bench.servos.torque == [0, 0]
    assert answer.success
    assert all(joint in answer.message for joint in JOINTS)
    wait_for(lambda: person.stopped)
    wait_for(lambda: person.latched("head_tracker/enabled", Bool) is False)
    assert person.state("head_tracker") == "disabled"
    before = bench.servos.at_rest()
    time.sleep(0.5)  # targets keep coming
    assert bench.servos.at_rest() == pytest.approx(before, abs=STILL)
    assert person.call("stop").success  # a second one is as good as the first


def test_nothing_moves_a_stopped_head_neither_by_command_nor_by_torque(bench, person):
    assert person.call("stop").success
    before = bench.servos.at_rest()
    onward = JointState(name=list(JOINTS), position=[before[0] + 0.5, before[1]])
    for what in (
        lambda: person.publish("joint_commands", onward),
        lambda: person.command("head_pan_controller", before[0] + 0.5),
        lambda: person.publish("head_pan_controller/speed", Float64(data=1.0)),
        lambda: person.call("torque_enable", True),
        lambda: person.call("head_tracker/recenter"),
        lambda: person.publish("joint_claims", onward),
    ):
        what()
        time.sleep(0.1)
    assert person.stopped
    assert bench.servos.at_rest() == pytest.approx(before, abs=STILL)


def test_resume_goes_on_slowly_at_first_with_what_was_on(bench, person):
    assert person.call("stop").success
    bench.servos.at_rest()
    assert person.call("resume").success
    first = person.pan
    began = time.monotonic()
    wait_for(lambda: abs(person.pan - first) > 0.1)
    assert abs(person.pan - first) / (time.monotonic() - began) < SLOW
    wait_for(lambda: not person.stopped)
    wait_for(lambda: person.state("head_tracker") == "tracking")
    wait_for(lambda: set(person.owners.values()) == {"/head_tracker"})


def test_what_was_off_before_a_stop_is_off_after_it(bench, person):
    assert person.call("head_tracker/enable", False).success
    assert person.call("stop").success
    assert person.call("resume").success
    wait_for(lambda: not person.stopped)
    before = bench.servos.at_rest()
    time.sleep(0.5)
    assert bench.servos.at_rest() == pytest.approx(before, abs=STILL)
    assert set(person.owners.values()) == {""}


def test_stop_and_resume_again_and_again_leave_what_was_on(bench, person):
    for _ in range(4):
        assert person.call("stop").success
        assert bench.servos.torque == [0, 0]
        assert person.call("resume").success
    wait_for(lambda: bench.servos.torque == [1, 1])
    wait_for(lambda: person.state("head_tracker") == "tracking")


def test_stop_is_answered_while_other_services_are_busy(bench, person):
    done = []
    busy = [threading.Thread(target=lambda: done.append(person.call("recover"))) for _ in range(4)]
    for thread in busy:
        thread.start()
    assert person.call("stop").success
    assert bench.servos.torque == [0, 0]
    for thread in busy:
        thread.join()
    assert len(done) == 4


def test_one_client_stops_while_another_commands(bench, person):
    other = bench.meet("")
    assert person.call("head_tracker/enable", False).success
    commanding = threading.Event()

    def command():
        while not commanding.wait(0.02):
            other.command("head_pan_controller", 0.6 * DEGREE * (time.monotonic() % 60))

    thread = threading.Thread(target=command)
    thread.start()
    try:
        wait_for(lambda: bench.servos.torque[0] == 1)
        assert person.call("stop").success
        assert bench.servos.torque == [0, 0]
        before = bench.servos.at_rest()
        time.sleep(0.3)
        assert bench.servos.at_rest() == pytest.approx(before, abs=STILL)
    finally:
        commanding.set()
        thread.join()
