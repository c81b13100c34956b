"""Clients that ask for anything at any time, in any composition: only `resume` ends a STOP."""

import math
import random
import time
from contextlib import closing, contextmanager
from functools import partial

import pytest
from rig import JOINTS, Bench
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from waiting import repeating, wait_for

STOPS = 8
NODES = ("joint_state_publisher", "robot_state_publisher", "head_tracker")
CALLS = (
    ("torque_enable", True),
    ("head_pan_controller/torque_enable", True),
    ("head_tilt_controller/torque_enable", True),
    ("head_tracker/enable", True),
    ("head_tracker/recenter", None),
    ("recover", None),
    ("head_pan_controller/start", None),
)


@pytest.fixture(scope="module", params=["a run", "a process for each node"])
def bench(request, tmp_path_factory):
    with closing(Bench(tmp_path_factory.mktemp("bench"))) as bench:
        if request.param == "a run":
            bench.run("--target", "fictitious", "--allow-others")
        else:
            bench.run_bus()
            for name in (*NODES, "fictitious_target"):
                bench.start(name)
        bench.person.wait_for_joints()
        yield bench


def ask_for_something(person, rnd):
    """One request or message of those that move a head that is not stopped."""
    position = rnd.uniform(-1.0, 1.0)
    message = JointState(name=list(JOINTS), position=[position, 0.0])
    message.header.frame_id = rnd.choice(("/other", "/head_tracker#0", "/head_tracker#1", ""))
    number = rnd.randrange(len(CALLS) + 4)
    if number < len(CALLS):
        person.call(*CALLS[number])
    elif number == len(CALLS):
        person.publish("joint_commands", message)
    elif number == len(CALLS) + 1:
        person.publish("joint_claims", message)
    elif number == len(CALLS) + 2:
        person.publish("head_pan_controller/command", Float64(data=position))
    else:
        person.look_at(2.0, math.sin(position), 0.5)


@contextmanager
def clients(bench, *acts):
    """Each act again and again, in a thread and with a node of its own."""
    errors = []

    def run(act, person):
        try:
            act(person)
        except AssertionError as error:
            errors.append(error)

    with repeating(*(partial(run, act, bench.meet("")) for act in acts)):
        yield
    assert not errors


def stop_and_resume(bench, rnd):
    person = bench.person
    wait_for(lambda: bench.servos.torque == [1, 1], 30.0)
    time.sleep(rnd.uniform(0.0, 0.3))
    person.call("stop")  # on a busy computer it may not be confirmed in time, but it counts
    wait_for(lambda: bench.servos.torque == [0, 0])
    ends = time.monotonic() + rnd.uniform(0.2, 0.8)
    while time.monotonic() < ends:
        assert bench.servos.torque == [0, 0]
        time.sleep(0.002)
    assert person.call("resume").success


@pytest.mark.parametrize("seed", [1, 2])
def test_random_requests_of_two_clients_do_not_undo_stop(bench, seed):
    rnd, of_client = random.Random(seed), [random.Random(seed + n) for n in (10, 20)]
    acts = [lambda person, own=own: ask_for_something(person, own) for own in of_client]
    with clients(bench, *acts):
        for _ in range(STOPS):
            stop_and_resume(bench, rnd)


def test_a_client_that_enables_everything_at_20_hz_does_not_undo_stop(bench):
    def supervise(person):
        person.call("head_tracker/enable", True)
        person.call("torque_enable", True)
        time.sleep(0.05)

    with clients(bench, supervise):
        for _ in range(STOPS):
            stop_and_resume(bench, random.Random(3))
