"""Connecting, reading, commands and torque: the bus on a fake port, in passed-in time."""

import math
import os
from dataclasses import replace
from functools import partial

import pytest
from dynamixel_fakes import (
    GOAL,
    PAN,
    TILT,
    TORQUE,
    FakeRig,
    goal_bytes,
    speed_ticks,
    writes,
)
from simulated_device import PERIOD, Bench, joint_of

from head_tracking.dynamixel import (
    ConfigurationError,
    EventKind,
    Goal,
    GoalError,
    Health,
    Torque,
    TorqueError,
    servo_model,
)
from head_tracking.dynamixel.exceptions import NotConnectedError, ServoError, ServoNotFoundError
from head_tracking.dynamixel.protocol import ErrorBits
from head_tracking.dynamixel.servo import run
from head_tracking.dynamixel.state import Counters
from head_tracking.simulation import SimulatedServo

JOINTS = (PAN, TILT)


# Connecting


def test_connect_relaxes_every_servo_and_writes_nothing_else():
    rig = FakeRig(connect=False)
    rig.pan["Torque Enable"] = rig.tilt["Torque Enable"] = 1
    rig.bus.connect()
    assert writes(rig.log) == [("write", 1, 24, b"\x00"), ("write", 2, 24, b"\x00")]
    for servo_id in (1, 2):
        written = rig.log.index(("write", servo_id, 24, b"\x00"))
        assert ("read", servo_id, 24, 1) in rig.log[written:]  # verified


def test_connect_names_missing_ids_after_a_second_try():
    rig = FakeRig(connect=False)
    rig.tilt.answers = False
    with pytest.raises(ServoNotFoundError) as info:
        rig.connect()
    assert (info.value.asked, info.value.answered) == ((1, 2), (1,))
    assert not rig.bench.port.is_open
    rig.tilt.answers = True
    rig.tilt.mute.append(True)
    assert rig.bus.connect() == "2 AX-12 servos: ids 1, 2"


@pytest.mark.parametrize("first", [1, 2, 5])
def test_connect_asks_again_if_a_servo_that_answers_pings_then_falls_silent(first):
    """Beside other work a Python program may miss all replies for a while."""
    rig = FakeRig(connect=False)
    rig.tilt.mute.extend([False] * first + [True] * 6)
    rig.connect()
    assert rig.tilt["Torque Enable"] == 0
    assert len(rig.step().states) == 2


def test_many_servos_of_another_model_are_refused_soon():
    rig = FakeRig(
        *[replace(PAN, joint_name=f"j{i}", controller=f"c{i}", id=i) for i in range(9)],
        connect=False,
    )
    for servo in rig.servos:
        servo.set_register("Model Number", 29)
    begin = rig.bench.now()
    with pytest.raises(ServoError, match="servo 0 "):
        rig.connect()
    assert rig.bench.now() - begin < 500_000_000


@pytest.mark.parametrize(
    ("registers", "ignored", "error", "message"),
    [
        ({"Model Number": 29}, set(), ServoError, r"servo 1 .*29.*AX-12 \(12\)"),
        ({"Model Number": 4711}, set(), ServoError, "4711.*correct the configuration"),
        ({"Status Return Level": 0}, set(), ServoError, "--model 'AX-12' set 1 '"),
        ({}, {24}, ServoError, "Torque Enable"),
    ],
)
def test_connect_refuses_a_servo_that_it_cannot_use(registers, ignored, error, message):
    rig = FakeRig(connect=False)
    servo = rig.pan
    for name, value in {"Torque Enable": 1, **registers}.items():
        servo[name] = value
    servo.ignored = ignored
    with pytest.raises(error, match=message):
        rig.bus.connect()
    assert not rig.bench.port.is_open
    assert servo["Torque Enable"] == 1  # nothing is written to another model


X, STS = "XL430-W250", "STS3215"


@pytest.mark.parametrize(
    ("name", "register", "value", "options", "refused"),
    [
        ("AX-12", "CCW Angle Limit", 0, {}, True),  # wheel mode
        (X, "Operating Mode", 4, {}, True),  # extended position
        (X, "Drive Mode", 4, {}, True),  # a profile velocity would be milliseconds
        (X, "Startup Configuration", 1, {}, True),  # it would go on after a loss of power
        (X, "Drive Mode", 0, {"reverse": True}, True),  # another driver has reversed it
        (X, "Drive Mode", 1, {"reverse": False}, True),
        (X, "Drive Mode", 0, {"reverse": False}, False),
        (X, "Drive Mode", 1, {"reverse": True}, False),
        (X, "Drive Mode", 1, {}, False),
        ("MX-106", "Drive Mode", 1, {"reverse": False}, True),
        ("MX-106", "Drive Mode", 1, {"reverse": True}, False),
        (STS, "Phase", 28, {}, True),  # lerobot PR 3348: positions run beyond 0 to 4095
        (STS, "Phase", 8, {}, True),  # coarse speeds
        (STS, "Position Offset", 85, {"offset": 0}, True),  # lerobot issues 1342, 1360
        (STS, "Position Offset", 2048 + 85, {"offset": -85}, False),
    ],
)
def test_a_servo_that_is_set_up_otherwise_is_refused_and_relaxed(
    name, register, value, options, refused
):
    model = servo_model(name)
    servo = SimulatedServo(1, model)
    servo.set_register(register, value)
    servo.set_register("Torque Enable", 1)
    assert Bench([servo]).accepts([replace(joint_of(1, model), **options)]) is not refused
    assert servo.register("Torque Enable") == 0
    assert servo.register(register) == value


def test_servos_own_angle_limits_narrow_the_range():
    rig = FakeRig(connect=False)
    rig.pan["CW Angle Limit"] = 400
    rig.tilt["CCW Angle Limit"] = 700
    rig.connect()
    assert rig.bus.joint("head_pan_joint").limits == (PAN.position(400), PAN.position(1023))
    assert rig.bus.joint("head_tilt_joint").limits == (TILT.position(300), TILT.position(700))
    rig.bus.close()
    rig.tilt["CCW Angle Limit"] = 250  # no overlap
    with pytest.raises(ConfigurationError):
        rig.bus.connect()


def test_bus_must_be_connected():
    bus = FakeRig(connect=False).bus
    for use in (
        bus.step,
        lambda: run(bus.switching_torque(None, True)),
        lambda: bus.command({}),
    ):
        with pytest.raises(NotConnectedError):
            use()


# Reading


def test_reading_has_si_units():
    rig = FakeRig(connect=False)
    servo = rig.pan
    servo["Present Position"] = 612
    servo["Present Speed"] = 1024 + 50
    servo["Present Load"] = 300
    servo["Present Voltage"] = 111
    servo["Present Temperature"] = 41
    servo.error = ErrorBits.INPUT_VOLTAGE
    rig.connect()
    state, servo = rig.step().states["head_pan_joint"], rig.bus.servos[0]
    assert state.position == pytest.approx(0.5113, abs=1e-4)
    assert state.velocity == pytest.approx(-0.5812, abs=1e-4)
    assert state.goal is None
    assert servo.load == pytest.approx(300 / 1023)
    assert servo.voltage == pytest.approx(11.1)
    assert servo.temperature == 41.0
    assert servo.errors == ErrorBits.INPUT_VOLTAGE


def test_stamp_is_when_the_servo_had_heard_the_request():
    bench = Bench([SimulatedServo(1), SimulatedServo(2)])
    bus = bench.servo_bus(JOINTS)
    bus.connect()
    bench.pass_time(0.02)
    start = bench.now()
    reading = bus.step()
    request, reply = 8 * 10_000, 14 * 10_000 + 500_000  # with the default return delay
    pan, tilt = (reading.states[joint.joint_name].stamp - start for joint in JOINTS)
    assert pan == pytest.approx(request, abs=2000)
    assert tilt == pytest.approx(2 * request + reply, abs=20_000)


@pytest.mark.parametrize("register", ["Present Position", "Present Speed", "Present Load"])
def test_impossible_feedback_counts_as_corrupt_and_is_asked_for_again_at_once(rig, register):
    rig.pan[register] = 0xFFFF
    assert set(rig.step().states) == {"head_tilt_joint"}
    assert [request[:2] for request in rig.log[:3]] == [("read", 1), ("read", 1), ("read", 2)]
    counters = rig.bus.statistics().servos[0].counters
    assert counters == Counters(counters.replies, retries=1, timeouts=0, corrupt=2)


# Losing and finding servos


def test_a_command_that_came_while_its_servo_went_missing_moves_nothing_when_it_returns(rig):
    rig.pan.answers = False
    rig.step(4)
    rig.bus.command({"head_pan_joint": Goal(0.1)})
    rig.step()
    assert rig.lost == ["head_pan_joint"]
    rig.pan.answers = True
    rig.bench.pass_time(0.6)
    rig.step(5)
    assert rig.pan["Torque Enable"] == 0


def test_another_servo_in_its_place_is_not_used_and_relaxed_and_reported(rig):
    rig.pan.answers = False
    rig.step(5)
    rig.pan.answers = True
    rig.pan["Model Number"] = 29
    rig.pan["Torque Enable"] = 1
    events = []
    for _ in range(5):
        rig.bench.pass_time(0.6)
        events += rig.step().events
        assert rig.lost == ["head_pan_joint"]
    events += rig.step().events
    assert {event.kind for event in events} == {EventKind.UNUSABLE}
    assert [event.repeated for event in events] == [False, False, True, True, True]
    assert rig.pan["Torque Enable"] == 0


# The adapter unplugged


@pytest.mark.parametrize("kept", [True, False])
def test_bus_goes_on_without_its_port_and_finds_it_again(rig, kept):
    rig.switched_on(0.5)
    rig.bench.line.plugged = False
    reading = rig.step()
    assert (reading.states, rig.lost) == ({}, ["head_pan_joint", "head_tilt_joint"])
    assert [event.kind for event in reading.events] == [EventKind.PORT_LOST]
    assert not rig.bus.statistics().connected
    with pytest.raises(GoalError, match="does not answer"):
        rig.bus.command({"head_pan_joint": Goal(0.1)})
    rig.bench.line.plugged = True
    rig.pan["Torque Enable"] = int(kept)  # unless it has lost its power, too
    rig.bench.pass_time(0.3)
    readings = [rig.step() for _ in range(3)]
    kinds = [event.kind for reading in readings for event in reading.events]
    assert kinds == [EventKind.PORT_RETURNED, EventKind.RETURNED, EventKind.RETURNED]
    assert set(readings[-1].states) == {"head_pan_joint", "head_tilt_joint"}
    assert readings[-1].states["head_pan_joint"].goal == (0.0 if kept else None)  # where it stands
    assert rig.bus.joint("head_pan_joint").on is kept
    assert rig.torque == [kept, 0]
    assert (rig.bus.statistics().connected, rig.bus.statistics().port_losses) == (True, 1)
    rig.bench.line.plugged = False
    rig.step()
    rig.bench.line.plugged = True
    rig.pan["Torque Enable"] = 1  # whoever did that, if it was not kept
    rig.bench.pass_time(0.3)
    rig.step(3)
    assert rig.pan["Torque Enable"] == kept


def test_port_that_goes_between_two_cycles_is_found_again(rig, monkeypatch):
    rig.bench.line.plugged = False
    with pytest.raises(TorqueError):
        run(rig.bus.switching_torque(["head_pan_joint"], True))
    assert [event.kind for event in rig.step().events] == [EventKind.PORT_LOST]
    rig.bench.line.plugged = True
    rig.bench.pass_time(0.3)
    for transactions in range(4):  # until it fails
        left = iter([0] * transactions)
        with monkeypatch.context() as loose_plug:
            discard = lambda left=left: next(left, None) is None and os.close(-1)  # noqa: E731
            loose_plug.setattr(rig.bench.line, "discard_input", discard)
            assert rig.step().events == (), transactions
        rig.bench.pass_time(0.3)
    assert rig.step().events[0].kind is EventKind.PORT_RETURNED


@pytest.mark.parametrize("on", [True, False])
def test_port_that_goes_at_any_moment_is_found_again(on):
    """While one joint follows its goals and the torque of the other one is switched."""
    for moment in range(1, 25):
        rig = FakeRig().switched_on(0.5)
        run(rig.bus.switching_torque(["head_tilt_joint"], not on))
        rig.bus.requests.add(partial(rig.bus.switching_torque, ["head_tilt_joint"], on))
        rig.bus.requests.begin_next()
        line, count = rig.bench.line, len(rig.log) + moment
        write = line.write

        def write_until_then(data, rig=rig, count=count, write=write):
            rig.bench.line.plugged = len(rig.log) < count
            write(data)

        line.write = write_until_then
        kinds = []
        for _ in range(8):  # the steps of the request are taken within the cycles
            rig.bench.pass_time(PERIOD)
            kinds += [event.kind for event in rig.bus.step().events]
        assert kinds.count(EventKind.PORT_LOST) == 1, moment
        line.write, line.plugged = write, True
        rig.bench.pass_time(0.3)
        assert set(rig.step(5).states) == {"head_pan_joint", "head_tilt_joint"}


def test_bus_starts_without_a_servo_if_it_may():
    rig = FakeRig(connect=False)
    rig.tilt.answers = False
    assert rig.bus.connect(allow_missing=True) == "1 AX-12 servo: id 1"
    healths = [servo.health for servo in rig.bus.statistics().servos]
    assert healths == [Health.PRESENT, Health.UNKNOWN]
    with pytest.raises(GoalError):
        rig.bus.command({"head_tilt_joint": Goal(0.1)})
    assert (set(rig.step().states), rig.lost) == ({"head_pan_joint"}, ["head_tilt_joint"])
    rig.tilt.answers = True
    rig.bench.pass_time(0.6)
    assert rig.passed(2) == [EventKind.RETURNED]
    assert "head_tilt_joint" in rig.step().states


# Torque: what reaches the wire, and what never does


def test_the_first_command_holds_the_servo_where_it_stands_before_it_moves():
    rig = FakeRig(connect=False)
    rig.pan["Present Position"] = 450
    rig.connect()
    rig.bus.command({"head_pan_joint": Goal(0.5, 1.0)})
    assert rig.log == []
    assert rig.passed(2) == [EventKind.TORQUE_ON]
    assert writes(rig.log) == [
        ("write", 1, GOAL, goal_bytes(450, 1)),
        ("write", 1, TORQUE, b"\x01"),
        ("sync", GOAL, {1: goal_bytes(PAN.ticks(0.5), speed_ticks(PAN, 1.0))}),
    ]
    assert rig.bus.joint("head_pan_joint").torque is Torque.ON
    assert rig.bus.joint("head_tilt_joint").torque is Torque.OFF_UNTIL_COMMANDED


@pytest.mark.parametrize(("present", "goal"), [(250, 300), (900, 800)])
def test_servo_outside_its_limits_is_pinned_to_the_limit_at_the_lowest_speed(present, goal):
    rig = FakeRig(connect=False)
    rig.tilt["Present Position"] = present
    rig.connect()
    run(rig.bus.switching_torque(["head_tilt_joint"], True))
    assert writes(rig.log)[0] == ("write", 2, GOAL, goal_bytes(goal, 1))


@pytest.mark.parametrize("ignored", [False, True], ids=["refuses", "keeps its old goal"])
def test_servo_that_does_not_take_the_goal_is_left_relaxed(rig, ignored):
    if ignored:
        rig.pan.ignored.add(GOAL)
    else:
        rig.pan.error = ErrorBits.ANGLE_LIMIT
    with pytest.raises(TorqueError, match="head_pan_joint"):
        run(rig.bus.switching_torque(None, True))
    assert rig.bus.joint("head_pan_joint").torque is Torque.OFF_UNTIL_COMMANDED
    assert rig.bus.joint("head_tilt_joint").torque is Torque.ON
    rig.step()
    rig.bus.command({"head_pan_joint": Goal(0.5)})
    assert rig.passed(2) == [EventKind.TORQUE_FAILED]
    assert rig.pan["Torque Enable"] == 0
    assert ("write", 1, TORQUE, b"\x01") not in rig.log


# Commands


def test_goals_of_all_joints_go_out_in_one_packet_and_are_repeated(rig):
    rig.bus.command({"head_pan_joint": Goal(0.5, 1.0), "head_tilt_joint": Goal(-0.2, 0.5)})
    rig.step(2)
    expected = (
        "sync",
        GOAL,
        {
            1: goal_bytes(PAN.ticks(0.5), speed_ticks(PAN, 1.0)),
            2: goal_bytes(TILT.ticks(-0.2), speed_ticks(TILT, 0.5)),
        },
    )
    assert writes(rig.take_log())[-1] == expected
    rig.pan["Present Position"] = PAN.ticks(0.5)
    rig.tilt["Present Position"] = TILT.ticks(-0.2)
    rig.step()
    assert rig.log == [("read", 1, 36, 8), ("read", 2, 36, 8), expected]


def test_goal_without_speed_uses_the_joints_speed(rig):
    rig.bus.command({"head_pan_joint": Goal(0.5)})
    rig.step(2)
    assert rig.pan["Moving Speed"] == speed_ticks(PAN, 2.0)
    joint = rig.bus.joint("head_pan_joint")
    for impossible in (0.0, math.nan, math.inf):
        with pytest.raises(GoalError):
            joint.set_default_speed(impossible)
    assert joint.default_speed == 2.0
    joint.set_default_speed(0.5)
    assert joint.default_speed == 0.5
    rig.step(2)
    assert rig.pan["Moving Speed"] == speed_ticks(PAN, 0.5)


@pytest.mark.parametrize(("speed", "ticks"), [(1e-12, 1), (5e-3, 1), (50.0, 86), (1e308, 86)])
def test_speeds_are_neither_zero_on_the_wire_nor_above_the_limit(speed, ticks):
    rig = FakeRig(replace(PAN, joint_speed=0.5, max_speed=1.0))
    rig.bus.command({"head_pan_joint": Goal(0.5, speed)})
    rig.step(2)
    assert rig.pan["Moving Speed"] == ticks


@pytest.mark.parametrize(
    ("goals", "clamp"),
    [
        ({"head_pan_joint": Goal(math.nan)}, False),
        ({"head_pan_joint": Goal(math.inf)}, True),
        ({"head_pan_joint": Goal(0.1, 0.0)}, False),
        ({"head_pan_joint": Goal(0.1, -1.0)}, True),
        ({"head_pan_joint": Goal(0.1, math.nan)}, True),
        ({"head_pan_joint": Goal(0.1, math.inf)}, False),
        ({"elbow": Goal(0.1)}, True),
        ({"head_tilt_joint": Goal(2.0)}, False),
        ({"head_pan_joint": Goal(0.1), "head_tilt_joint": Goal(-2.0)}, False),
    ],
)
def test_bad_command_is_refused_and_nothing_moves(goals, clamp):
    rig = FakeRig()
    with pytest.raises(GoalError):
        rig.bus.command(goals, clamp=clamp)
    rig.step()
    assert writes(rig.log) == []
    assert rig.bus.statistics().refused_commands == 1


@pytest.mark.parametrize(
    ("position", "ticks", "clamps"),
    [
        (9.0, 800, True),
        (-9.0, 300, True),
        (TILT.upper + 1.01 * PAN.resolution, 800, True),
        (TILT.upper + 0.99 * PAN.resolution, 800, False),  # one tick counts as on the limit
    ],
)
def test_a_position_outside_the_limits_is_clamped_and_that_is_reported_or_refused(
    rig, position, ticks, clamps
):
    goals = {"head_tilt_joint": Goal(position)}
    if clamps:
        with pytest.raises(GoalError):
            rig.bus.command(goals)
    result = rig.bus.command(goals, clamp=clamps)
    assert result.goals == {"head_tilt_joint": Goal(TILT.position(ticks))}
    assert list(result.clamped) == ["head_tilt_joint"] * clamps
    assert rig.bus.statistics().clamped_commands == clamps
    rig.step(2)
    assert rig.tilt["Goal Position"] == ticks


def test_a_command_that_closing_overtakes_moves_nothing_when_the_bus_is_connected_again(rig):
    rig.bus.command({"head_pan_joint": Goal(0.5)}, claim=lambda _: rig.bus.close())
    rig.bus.connect()
    rig.take_log()
    rig.step()
    assert writes(rig.log) == []


# Commands that something overtakes after they were accepted


@pytest.mark.parametrize("overtakes", [False, True])
def test_a_command_before_its_joint_is_relaxed_is_dropped_and_no_failure(rig, overtakes):
    def relax(_=None):
        run(rig.bus.switching_torque(["head_pan_joint"], False))

    rig.bus.command({"head_pan_joint": Goal(0.5)}, claim=relax if overtakes else None)
    if not overtakes:
        relax()
    assert [event.kind for event in rig.step().events] == [EventKind.TORQUE_OFF]
    run(rig.bus.switching_torque(["head_pan_joint"], True))
    assert rig.step().states["head_pan_joint"].goal == PAN.position(512)
    assert rig.pan["Goal Position"] == 512
    relax()
    assert rig.step().states["head_pan_joint"].goal is None
