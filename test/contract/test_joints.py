"""The servo bus: joints by commands, by hand and by services; what is refused moves nothing."""

import math
import time
from functools import partial

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rig import DEGREE, JOINTS, LATCHED, TICK
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from waiting import wait_for

RUN = ("--without", "head")
PAN, TILT = "head_pan_controller", "head_tilt_controller"


@pytest.fixture
def bench(running):
    """The servos hold at the centre."""
    person = running.person
    for servo in (1, 2):
        running.servos.port.use(lambda bus, servo=servo: bus[servo].drive.push(0.0))
    person.until_done("torque_enable", True)
    for controller in (PAN, TILT):
        person.publish(f"{controller}/speed", Float64(data=3.0))

    def centred():  # (another sender's claim may have to end first)
        for controller in (PAN, TILT):
            person.command(controller, 0.0)
        return person.looks_at(0.0, 0.0)

    wait_for(centred)
    running.servos.at_rest()
    person.log.clear()
    return running


def joint_commands(*positions, names=JOINTS, velocities=(), sender=""):
    message = JointState(name=list(names), position=list(positions), velocity=list(velocities))
    message.header.frame_id = sender
    return message


def test_a_command_moves_one_joint_and_all_topics_report_its_position(bench, person):
    person.command(PAN, 0.5)
    wait_for(lambda: abs(person.pan - 0.5) < DEGREE)
    pan, tilt = bench.servos.at_rest()
    assert pan == pytest.approx(0.5, abs=DEGREE)
    assert tilt == pytest.approx(0.0, abs=DEGREE)
    states = person.hear("servo_states", JointState)
    wait_for(lambda: states)
    assert dict(zip(states[-1].name, states[-1].position, strict=True)) == pytest.approx(
        {JOINTS[0]: pan, JOINTS[1]: tilt}, abs=2 * TICK
    )
    assert len(states[-1].velocity) == 2
    assert not states[-1].effort  # a servo measures a share of its full load, and no torque


def test_the_speed_can_be_set(person):
    states = person.hear("servo_states", JointState)
    person.publish(f"{PAN}/speed", Float64(data=0.5))
    states.clear()
    person.command(PAN, 1.0)
    wait_for(lambda: abs(person.pan - 1.0) < DEGREE)
    velocities = [abs(state.velocity[0]) for state in states if len(state.name) == 2]
    assert 0.4 < max(velocities) < 0.65


def test_a_relaxed_joint_is_turned_by_hand_and_does_not_jump_back(bench, person):
    person.until_done(f"{PAN}/torque_enable", False)
    assert bench.servos.torque == [0, 1]
    bench.servos.turn_by_hand(1, -0.7)
    wait_for(lambda: abs(person.pan + 0.7) < 3 * DEGREE)
    onward = joint_commands(1.0, names=JOINTS[:1])
    person.complaint("servo_bus", JOINTS[0], of=lambda: person.publish("joint_commands", onward))
    before, _ = bench.servos.at_rest()
    person.until_done(f"{PAN}/torque_enable", True)
    assert bench.servos.torque == [1, 1]
    assert bench.servos.at_rest()[0] == pytest.approx(before, abs=DEGREE)


def test_invalid_commands_are_refused_and_move_nothing(bench, person):
    """By different senders and topics in turns: each is logged once a second or less."""
    before, pan = bench.servos.true, JOINTS[:1]
    for topic, message, fact in (
        (f"{PAN}/command", Float64(data=2.7), "position 2.7"),
        (f"{PAN}/speed", Float64(data=0.0), "speed 0.0"),
        ("joint_commands", joint_commands(0.5, 0.5, names=pan), "2 positions"),
        ("joint_commands", joint_commands(0.5, names=["nose_joint"], sender="/a"), "nose_joint"),
        (f"{PAN}/command", Float64(data=-3.0), "position -3.0"),
        (f"{PAN}/speed", Float64(data=-1.0), "speed -1.0"),
        ("joint_commands", joint_commands(names=pan), "0 positions"),
        ("joint_commands", joint_commands(0.5, math.nan, sender="/b"), "position nan"),
        (f"{PAN}/command", Float64(data=math.nan), "position nan"),
        (f"{PAN}/speed", Float64(data=math.nan), "speed nan"),
        ("joint_commands", joint_commands(0.5, names=()), "0 names"),
        ("joint_commands", joint_commands(0.5, names=pan, velocities=[0.0], sender="/c"), "/c"),
        (f"{PAN}/command", Float64(data=math.inf), "position inf"),
    ):
        person.log.clear()
        person.complaint("servo_bus", fact, of=partial(person.publish, topic, message))
    assert bench.servos.at_rest() == pytest.approx(before, abs=0.2 * DEGREE)


def test_a_flood_of_invalid_commands_is_logged_once_a_second_in_short_lines(person):
    claim = joint_commands(names=["x" * 9999], sender="y" * 9999)
    wrong = {
        f"{PAN}/command": Float64(data=math.nan),
        f"{PAN}/speed": Float64(data=math.nan),
        "joint_claims": claim,
        "joint_commands": joint_commands(0.5, names=["x" * 9999]),
    }
    person.log.clear()
    begun = time.monotonic()

    def flood():
        for _ in range(50):
            for topic, message in wrong.items():
                person.publish(topic, message)

    person.complaint("servo_bus", "no joint 'xxx", of=flood)
    lines = [each.msg for each in list(person.log) if "refused" in each.msg]
    assert len(lines) <= 5 * (1.0 + time.monotonic() - begun)
    assert max(map(len, lines)) <= 500


def test_a_stream_of_commands_is_clamped_to_the_limits(bench, person):
    person.publish("joint_commands", joint_commands(3.0, names=JOINTS[1:]))
    wait_for(lambda: abs(person.tilt - 288 * TICK) < DEGREE)
    assert bench.servos.register(2, "Goal Position") == 800


def test_an_overloaded_servo_is_reported_and_recovered(bench, person):
    diagnostics = person.hear("/diagnostics", DiagnosticArray)
    bench.servos.port.use(lambda bus: bus[1].overload())

    def level():
        entries = {s.name: s.level for message in diagnostics for s in message.status}
        return entries.get(f"servo_bus: {JOINTS[0]}")

    wait_for(lambda: level() == DiagnosticStatus.ERROR)
    assert bench.servos.torque[0] == 0
    person.until_done("recover")
    assert bench.servos.register(1, "Torque Limit") == 1023
    person.command(PAN, -0.2)
    wait_for(lambda: abs(person.pan + 0.2) < DEGREE)
    wait_for(lambda: level() == DiagnosticStatus.OK)
    person.until_done(f"{PAN}/recover")


def test_one_joint_is_stopped_and_started_without_the_other(bench, person):
    person.command(TILT, 0.2)
    person.until_done(f"{PAN}/stop")
    wait_for(lambda: abs(person.tilt - 0.2) < DEGREE)
    wait_for(lambda: person.measured[JOINTS[1]][0] > person.measured[JOINTS[0]][0] + 0.5)
    person.complaint("servo_bus", PAN, of=lambda: person.command(PAN, 0.3))
    for service in ("start", "restart"):
        person.until_done(f"{PAN}/{service}")
    person.command(PAN, 0.3)
    wait_for(lambda: abs(person.pan - 0.3) < DEGREE)


def test_limits_change_at_run_time_and_invalid_values_are_refused(person):
    heard = person.hear("joint_control", DiagnosticStatus, LATCHED)

    def highest():
        fields = {each.key: each.value for each in heard[-1].values} if heard else {}
        return float(fields.get(f"limits of {JOINTS[0]}", "0 0").split()[1])

    wait_for(lambda: highest() > 2.0)
    assert person.set("servo_bus", f"{PAN}.motor.max", 600).successful
    wait_for(lambda: highest() == pytest.approx((600 - 512) * TICK, abs=1e-3))
    person.complaint("servo_bus", JOINTS[0], of=lambda: person.command(PAN, 0.9))
    for name, bad in (("motor.max", 2000), ("max_speed", 50.0), ("joint_speed", "fast")):
        refused = person.set("servo_bus", f"{PAN}.{name}", bad)
        assert not refused.successful
        assert refused.reason
    assert person.set("servo_bus", f"{PAN}.motor.max", 1023).successful
    person.command(PAN, 0.9)
    wait_for(lambda: abs(person.pan - 0.9) < DEGREE)


def test_the_eeprom_is_written_on_request_while_relaxed(bench, person):
    assert not person.call("servo_bus/write_eeprom").success
    assert bench.servos.register(2, "CCW Angle Limit") == 1023
    person.until_done("relax")
    assert person.call("servo_bus/write_eeprom").success
    assert bench.servos.register(2, "CCW Angle Limit") == 800
    assert person.call("servo_bus/write_eeprom").success


def test_commands_of_another_sender_wait_until_the_first_ends(person):
    def owned(sender, pan):
        person.publish("joint_commands", joint_commands(pan, names=JOINTS[:1], sender=sender))
        return person.owners[JOINTS[0]] == sender

    wait_for(lambda: owned("/first", 0.1))
    person.complaint(  # a busy machine may pause for longer than a command counts
        "servo_bus", "/first", "/second", of=lambda: owned("/first", 0.1) and owned("/second", 0.4)
    )
    wait_for(lambda: owned("/second", 0.4))
    wait_for(lambda: abs(person.pan - 0.4) < DEGREE)
