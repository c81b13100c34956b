"""One head for each domain and namespace: on a machine by a lock, between machines by claims."""

import json
import subprocess
import sys
import threading
import time

import pytest
import rclpy
from rclpy.context import Context
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String
from waiting import PATIENCE, join, wait_for

from head_tracking.exceptions import RefusedError
from head_tracking.ros.bus import servo_bus
from head_tracking.ros.kit.head_claim import HeadClaim, is_heard_elsewhere
from head_tracking.ros.kit.head_lock import HeadLock, domain_and_namespace, namespace
from head_tracking.ros.kit.topics import LATCHED


@pytest.fixture
def lock(tmp_path):
    made = []

    def make(*arguments, simulated=False):
        made.append(HeadLock(arguments, simulated=simulated, folder=tmp_path))
        return made[-1]

    yield make
    for one in made:
        one.release()


@pytest.mark.parametrize(
    ("word", "code", "fact"),
    [("--help", 0, "docs/reference/parameters.md"), ("--baud", 2, "--baud")],
)
def test_help_and_a_misspelt_argument_end_no_simulated_head(monkeypatch, capsys, word, code, fact):
    monkeypatch.setattr(sys, "argv", ["servo_bus", word])
    monkeypatch.setattr(HeadLock, "acquire", lambda *_, **__: pytest.fail("it is locked"))
    with pytest.raises(SystemExit) as ended:
        servo_bus.main()
    assert ended.value.code == code
    assert fact in "".join(capsys.readouterr())


def sleep(seconds):
    time.sleep(seconds)
    return False


def test_a_simulated_head_ends_for_a_real_one(lock):
    simulated, real = lock(simulated=True), lock()
    simulated.acquire(sleep)
    assert not simulated.is_wanted
    waiting = threading.Thread(target=real.acquire, args=(sleep,))
    waiting.start()
    wait_for(lambda: simulated.is_wanted)
    assert waiting.is_alive()
    with pytest.raises(RefusedError):
        lock(simulated=True).acquire(sleep)
    simulated.release()
    join(waiting)
    assert len(real.descriptors) == 2


def test_a_real_head_that_waits_too_long_is_refused(lock):
    lock(simulated=True).acquire(sleep)
    with pytest.raises(RefusedError):
        lock().acquire(sleep, patience=0.1)


@pytest.mark.parametrize("is_link", [True, False], ids=["a link", "no folder"])
def test_a_lock_that_cannot_be_opened_is_refused(tmp_path, is_link):
    if is_link:
        name = f"head_tracking_{domain_and_namespace(())}.head.lock"
        (tmp_path / name).symlink_to(tmp_path)
    folder = tmp_path if is_link else tmp_path / "missing"
    with pytest.raises(RefusedError):
        HeadLock((), simulated=True, folder=folder).acquire(sleep)


def test_the_lock_lasts_as_long_as_a_process_that_inherited_it(lock):
    simulated = lock(simulated=True)
    simulated.acquire(sleep)
    child = subprocess.Popen(
        [sys.executable, "-c", "input()"], stdin=subprocess.PIPE, pass_fds=simulated.descriptors
    )
    simulated.release()
    with pytest.raises(RefusedError):
        lock(simulated=True).acquire(sleep)
    child.kill()
    child.communicate(timeout=PATIENCE)
    lock(simulated=True).acquire(sleep)


@pytest.mark.parametrize(
    ("arguments", "found"),
    [
        (("--ros-args", "--remap", "__ns:=a/b"), "/a/b"),
        (("--ros-args", "-r", "__ns:=/a", "-r", "__ns:=/b"), "/a"),
        (("--ros-args", "-r", "target_point:=/x", "-r", "viewer:__ns:=/y"), "/"),
    ],
)
def test_the_namespace_of_all_nodes_is_read_as_ros_does(arguments, found):
    assert namespace(arguments) == found


@pytest.mark.parametrize("text", ["07", "0x7", ""])
def test_the_domain_is_read_as_ros_does(monkeypatch, text):
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    assert domain_and_namespace(()) == str(context.get_domain_id())
    context.shutdown()


# between machines


@pytest.fixture
def node(bench):
    return lambda: bench.meet("").node


def refused(claim):
    try:
        claim.check()
    except RefusedError:
        return True
    return False


def test_of_two_heads_that_hear_of_each_other_the_older_goes_on(node):
    older = HeadClaim(node(), simulated=False)
    younger = HeadClaim(node(), simulated=False)
    older.begin()
    younger.begin()
    wait_for(lambda: refused(younger))
    older.check()


def test_a_simulated_head_ends_for_a_real_one_that_comes_later(node):
    simulated = HeadClaim(node(), simulated=True)
    simulated.begin()
    real = HeadClaim(node(), simulated=False)
    wait_for(lambda: refused(simulated))
    time.sleep(0.1)
    real.check()
    real.begin()


def test_invalid_claims_are_ignored(node):
    claim = HeadClaim(node(), simulated=True)
    claim.begin()
    other = node()
    publisher = other.create_publisher(String, "head_claim", LATCHED)
    wait_for(publisher.get_subscription_count)
    for rank in ([None], [], [False], [None] * 4, [False, False, 10**400, ""]):
        publisher.publish(String(data=json.dumps({"rank": rank, "head": 3})))
    for data in ("", "7", "{}", "[" * 100_000):
        publisher.publish(String(data=data))
    wait_for(lambda: other.count_publishers("head_claim") == 2)
    time.sleep(0.1)
    claim.check()


@pytest.mark.parametrize(
    ("environment", "heard"),
    [
        ({}, True),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, True),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, False),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_STATIC_PEERS": "robot"}, True),
        ({"ROS_LOCALHOST_ONLY": "1", "ROS_DISCOVERY_SERVER": "10.0.0.1:11811"}, True),
        ({"ROS_LOCALHOST_ONLY": "1"}, False),
    ],
)
def test_which_discovery_ranges_reach_other_machines(environment, heard):
    assert is_heard_elsewhere(environment) is heard
