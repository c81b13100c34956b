"""STOP relaxes everything, whoever runs the head and asks for what; only `resume` ends it."""

import math
import os
import signal
import time
from contextlib import closing

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rig import JOINTS, LATCHED, Bench, child
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64
from waiting import repeating, wait_for

STILL = 0.015  # rad: a joint that is relaxed moves on a little
SLOW = 0.6  # rad/s
NODES = ("joint_state_publisher", "robot_state_publisher", "head_tracker")
REFUSED = [
    ("torque_enable", True),
    ("head_pan_controller/torque_enable", True),
    ("head_tracker/enable", True),
    ("head_tracker/recenter", None),
    ("recover", None),
    ("head_pan_controller/start", None),
    ("servo_bus/torque_enable", True),
    ("head_pan_controller/recover", None),
    ("head_pan_controller/restart", None),
    ("servo_bus/write_eeprom", None),
]


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
            bench.bus = bench.run_bus()
            for name in NODES:
                bench.start(name)
        bench.person.wait_for_joints()
        with repeating(lambda: bench.person.look_at(*swing(time.monotonic())), period=0.03):
            yield bench


@pytest.fixture
def bench(running):
    """The head follows."""
    person = running.person
    person.until_done("resume")
    person.until_done("torque_enable", True)
    person.until_done("head_tracker/enable", True)
    wait_for(lambda: person.state("head_tracker") == "tracking" and not person.stopped)
    assert running.servos.torque == [1, 1]
    person.log.clear()
    return running


def fields(person, topic):
    """Return level and fields of a latched topic."""
    messages = person.hear(topic, DiagnosticStatus, LATCHED)
    latest = wait_for(lambda: messages)[-1]
    return {"level": latest.level} | {each.key: each.value for each in latest.values}


def test_stop_relaxes_the_servos_and_is_published(bench, person):
    def status():
        found = fields(person, "head_tracker/status")
        return [found[name] for name in ("level", "state", "enabled", "stopped", "slow")]

    wait_for(lambda: status() == [DiagnosticStatus.OK, "tracking", "true", "false", "false"])
    answer = person.until_done("stop")
    assert bench.servos.torque == [0, 0]
    assert all(joint in answer.message for joint in JOINTS)
    wait_for(lambda: person.stopped)
    wait_for(lambda: person.latched("head_tracker/enabled", Bool) is False)
    wait_for(lambda: status() == [DiagnosticStatus.WARN, "disabled", "false", "true", "true"])
    wait_for(lambda: person.state("head_tracker") == "disabled")
    messages = person.hear("head_tracker/status", DiagnosticStatus, LATCHED)
    wait_for(lambda: messages[-1].message == person.latched("head_tracker/state"))
    before = bench.servos.at_rest()
    time.sleep(0.5)  # targets keep coming
    assert bench.servos.at_rest() == pytest.approx(before, abs=STILL)
    person.until_done("stop")  # a second one is as good as the first
    person.until_done("resume")
    wait_for(lambda: status()[2:4] == ["true", "false"])


def test_a_crash_does_not_end_a_stop(tmp_path):
    """As where a service starts what has crashed again. An end by a signal is no crash."""
    with closing(Bench(tmp_path)) as bench:

        def start():
            """Return a run and a person who has heard nothing of an earlier one."""
            return bench.run("--target", "smooth", "--keep-stop"), bench.meet("")

        def stop_when_it_tracks(person):
            wait_for(lambda: person.state("head_tracker") == "tracking")
            person.until_done("stop")
            assert bench.servos.torque == [0, 0]
            return bench.servos.at_rest()

        run, person = start()
        before = stop_when_it_tracks(person)
        os.kill(child(run.process.pid, "control"), signal.SIGKILL)
        run.end()
        run, person = start()
        assert person.stopped
        person.wait_for_joints()
        time.sleep(1.0)  # targets come
        assert bench.servos.torque == [0, 0]
        assert bench.servos.at_rest() == pytest.approx(before, abs=STILL)
        assert not person.call("head_tracker/enable", True).success
        run.process.kill()  # the supervisor; control ends by itself
        run.end()
        run, person = start()
        assert person.stopped
        person.until_done("resume")
        stop_when_it_tracks(person)
        assert run.end(signal.SIGTERM) == 0
        run, person = start()
        assert not person.stopped
        wait_for(lambda: person.state("head_tracker") == "tracking")
        assert run.end(signal.SIGINT) == 0


def test_a_stopped_head_refuses_every_service_but_resume(bench, person):
    person.until_done("stop")
    answers = [person.call(name, data) for name, data in REFUSED]
    assert [answer.success for answer in answers] == [False] * len(REFUSED)
    assert all(answer.message for answer in answers)
    assert bench.servos.torque == [0, 0]
    assert person.stopped


def test_no_topic_moves_a_stopped_head(bench, person):
    person.until_done("stop")
    before = bench.servos.at_rest()
    onward = JointState(name=list(JOINTS), position=[before[0] + 0.5, before[1]])
    onward.header.frame_id = "/other"
    for _ in range(3):  # targets keep coming, too
        person.publish("joint_claims", onward)
        person.publish("joint_commands", onward)
        person.command("head_pan_controller", before[0] + 0.5)
        person.publish("head_pan_controller/speed", Float64(data=1.0))
        time.sleep(0.1)
    assert person.stopped
    assert bench.servos.torque == [0, 0]
    wait_for(lambda: set(person.owners.values()) == {""})
    assert bench.servos.at_rest() == pytest.approx(before, abs=STILL)


def test_requests_to_relax_are_executed_while_stopped(bench, person):
    person.until_done("stop")
    person.until_done("relax")
    person.until_done("head_pan_controller/torque_enable", False)
    relaxed, holding = JOINTS
    message = person.until_done("resume").message
    assert relaxed in message and holding not in message  # commands for it are still refused
    wait_for(lambda: bench.servos.torque == [0, 1])
    person.until_done("torque_enable", True)
    assert bench.servos.torque == [1, 1]


@pytest.mark.parametrize("claimed", [JOINTS, JOINTS[1:]])
def test_a_claim_takes_over_the_head_until_it_is_enabled_again(person, claimed):
    """A controller that loses one joint releases the other."""
    first = person.pan
    wait_for(lambda: abs(person.pan - first) > 0.05)
    claim = JointState(name=list(claimed))
    claim.header.frame_id = "/other"
    owners = dict.fromkeys(JOINTS, "") | dict.fromkeys(claimed, "/other")
    wait_for(lambda: person.publish("joint_claims", claim) or person.owners == owners)
    wait_for(lambda: person.latched("head_tracker/enabled", Bool) is False)
    wait_for(lambda: set(person.owners.values()) == {""})  # it sends no commands, or is dead
    assert person.call("head_tracker/enable", True).success
    wait_for(lambda: set(person.owners.values()) == {"/head_tracker"})


def test_commands_of_an_earlier_epoch_are_discarded(bench, person):
    """As a message that was long on its way."""

    def publish(epoch):
        onward.header.frame_id = f"/elsewhere#{epoch}"
        person.publish("joint_commands", onward)

    def epoch():
        return int(fields(person, "joint_control")["epoch"])

    assert person.call("head_tracker/enable", False).success
    old = epoch()
    person.until_done("stop")
    person.until_done("resume")
    wait_for(lambda: epoch() > old)
    before = bench.servos.at_rest()
    onward = JointState(name=[JOINTS[0]], position=[before[0] + 0.5])
    person.complaint("servo_bus", "/elsewhere", of=lambda: publish(old))
    assert bench.servos.at_rest() == pytest.approx(before, abs=STILL)
    wait_for(lambda: publish(epoch()) or abs(person.pan - before[0]) > 0.4)


def test_resume_restores_the_owner_and_starts_slowly(bench, person):
    person.until_done("stop")
    bench.servos.at_rest()
    person.until_done("resume")
    first = person.pan
    assert person.mean_speed(lambda: abs(person.pan - first) > 0.1) < SLOW
    wait_for(lambda: not person.stopped)
    wait_for(lambda: person.state("head_tracker") == "tracking")
    wait_for(lambda: set(person.owners.values()) == {"/head_tracker"})


def test_a_disabled_head_stays_disabled_after_stop_and_resume(bench, person):
    assert person.call("head_tracker/enable", False).success
    person.until_done("stop")
    person.until_done("resume")
    wait_for(lambda: not person.stopped)
    wait_for(lambda: bench.servos.torque == [1, 1])
    before = bench.servos.at_rest()
    time.sleep(0.5)
    assert bench.servos.at_rest() == pytest.approx(before, abs=STILL)
    wait_for(lambda: set(person.owners.values()) == {""})


def test_a_servo_bus_that_was_killed_stays_stopped_though_commands_come(tmp_path):
    """Of a program that does not know of the STOP; after an orderly end the bus is as new."""
    with closing(Bench(tmp_path)) as bench:
        bus, person = bench.run_bus(), bench.person
        onward = JointState(name=list(JOINTS), position=[0.3, 0.2])
        with repeating(lambda: person.publish("joint_commands", onward), period=0.01):
            wait_for(lambda: bench.servos.torque == [1, 1])
            person.until_done("stop")
            bus.kill()
            bus = bench.run_bus()
            assert not person.call("torque_enable", True).success
            time.sleep(0.5)  # commands keep coming
            assert bench.servos.torque == [0, 0]
            person.until_done("resume")
            wait_for(lambda: bench.servos.torque == [1, 1])
            person.until_done("stop")
            assert bus.end(signal.SIGTERM) == 0
            bus = bench.run_bus()
            wait_for(lambda: bench.servos.torque == [1, 1])
