"""Commands and torque: what reaches the wire, and what never does."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from dynamixel_fakes import (
    GOAL,
    PAN,
    TILT,
    TORQUE,
    FakePort,
    connected,
    goal_bytes,
    speed_ticks,
    writes,
)

from head_tracking.dynamixel import (
    EventKind,
    Goal,
    GoalError,
    ServoBus,
    Torque,
    TorqueError,
)
from head_tracking.dynamixel.protocol import ErrorBits
from head_tracking.dynamixel.servo import run

TICK = PAN.resolution


# Torque


def test_the_first_command_holds_the_servo_where_it_stands_before_it_moves() -> None:
    port = FakePort()
    port.servos[1]["Present Position"] = 450
    bus = connected(port)
    bus.command({"head_pan_joint": Goal(0.5, 1.0)})
    assert port.log == []
    assert [event.kind for event in bus.step().events] == [EventKind.TORQUE_ON]
    assert writes(port.log) == [
        ("write", 1, GOAL, goal_bytes(450, 1)),
        ("write", 1, TORQUE, b"\x01"),
        ("sync", GOAL, {1: goal_bytes(PAN.ticks(0.5), speed_ticks(PAN, 1.0))}),
    ]
    assert bus.joint("head_pan_joint").torque is Torque.ON
    assert bus.joint("head_tilt_joint").torque is Torque.OFF_UNTIL_COMMANDED


def test_goal_of_the_moment_before_torque_off_is_dropped(port, bus) -> None:
    bus.command({"head_pan_joint": Goal(0.5)})
    run(bus.switching_torque(["head_pan_joint"], False))
    run(bus.switching_torque(["head_pan_joint"], True))
    assert bus.step().states["head_pan_joint"].goal == PAN.position(512)
    assert port.servos[1]["Goal Position"] == 512
    run(bus.switching_torque(["head_pan_joint"], False))
    assert bus.step().states["head_pan_joint"].goal is None


@pytest.mark.parametrize(("present", "goal"), [(250, 300), (900, 800)])
def test_servo_outside_its_limits_is_pinned_to_the_limit_at_the_lowest_speed(
    present: int, goal: int
) -> None:
    port = FakePort()
    port.servos[2]["Present Position"] = present
    bus = connected(port)
    run(bus.switching_torque(["head_tilt_joint"], True))
    assert writes(port.log)[0] == ("write", 2, GOAL, goal_bytes(goal, 1))


@pytest.mark.parametrize("ignored", [False, True], ids=["refuses", "keeps its old goal"])
def test_servo_that_does_not_take_the_goal_is_left_relaxed(port, bus, ignored: bool) -> None:
    if ignored:
        port.servos[1].ignored.add(GOAL)
    else:
        port.servos[1].error = ErrorBits.ANGLE_LIMIT
    with pytest.raises(TorqueError, match="head_pan_joint"):
        run(bus.switching_torque(None, True))
    assert bus.joint("head_pan_joint").torque is Torque.OFF_UNTIL_COMMANDED
    assert bus.joint("head_tilt_joint").torque is Torque.ON
    bus.step()
    bus.command({"head_pan_joint": Goal(0.5)})
    events = [(event.kind, event.joint_name) for event in bus.step().events]
    assert events == [(EventKind.TORQUE_FAILED, "head_pan_joint")]
    assert port.servos[1]["Torque Enable"] == 0
    assert ("write", 1, TORQUE, b"\x01") not in port.log


def test_torque_of_a_lost_servo(port, bus) -> None:
    port.servos[1].answers = False
    for _ in range(5):
        bus.step()
    with pytest.raises(TorqueError, match="does not answer"):
        run(bus.switching_torque(["head_pan_joint"], True))
    port.take_log()
    with pytest.raises(TorqueError, match="does not answer"):
        run(bus.switching_torque(["head_pan_joint"], False))
    assert port.log == [("sync", TORQUE, {1: b"\0"})]  # tried all the same


def test_torque_of_an_unknown_joint_switches_nothing(port, bus) -> None:
    with pytest.raises(GoalError, match=r"no joint 'elbow'.*head_pan_joint, head_tilt_joint"):
        run(bus.switching_torque(["head_pan_joint", "elbow"], True))
    assert port.log == []


# Commands


def test_goals_of_all_joints_go_out_in_one_packet_and_are_repeated(
    port: FakePort, bus: ServoBus
) -> None:
    bus.command({"head_pan_joint": Goal(0.5, 1.0), "head_tilt_joint": Goal(-0.2, 0.5)})
    bus.step()
    expected = (
        "sync",
        GOAL,
        {
            1: goal_bytes(PAN.ticks(0.5), speed_ticks(PAN, 1.0)),
            2: goal_bytes(TILT.ticks(-0.2), speed_ticks(TILT, 0.5)),
        },
    )
    assert writes(port.take_log())[-1] == expected
    port.servos[1]["Present Position"] = PAN.ticks(0.5)
    port.servos[2]["Present Position"] = TILT.ticks(-0.2)
    bus.step()
    assert port.log == [("read", 1, 36, 8), ("read", 2, 36, 8), expected]


def test_goal_without_speed_uses_the_joints_speed(port, bus) -> None:
    bus.command({"head_pan_joint": Goal(0.5)})
    bus.step()
    assert port.servos[1]["Moving Speed"] == speed_ticks(PAN, 2.0)
    bus.joint("head_pan_joint").set_default_speed(0.5)
    assert bus.joint("head_pan_joint").default_speed == 0.5
    bus.step()
    assert port.servos[1]["Moving Speed"] == speed_ticks(PAN, 0.5)


@pytest.mark.parametrize(("speed", "ticks"), [(1e-12, 1), (5e-3, 1), (50.0, 86), (1e308, 86)])
def test_speeds_are_neither_zero_on_the_wire_nor_above_the_limit(speed: float, ticks: int) -> None:
    port = FakePort(1)
    bus = connected(port, replace(PAN, joint_speed=0.5, max_speed=1.0))
    bus.command({"head_pan_joint": Goal(0.5, speed)})
    bus.step()
    assert port.servos[1]["Moving Speed"] == ticks


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
def test_bad_command_is_refused_and_nothing_moves(goals: dict[str, Goal], clamp: bool) -> None:
    port = FakePort()
    bus = connected(port)
    with pytest.raises(GoalError):
        bus.command(goals, clamp=clamp)
    bus.step()
    assert writes(port.log) == []
    assert bus.statistics().refused_commands == 1


def test_one_tick_beyond_the_limit_counts_as_on_the_limit(port, bus) -> None:
    result = bus.command({"head_tilt_joint": Goal(TILT.upper + 0.99 * TICK)})
    assert result.positions == {"head_tilt_joint": TILT.upper}
    assert result.clamped == {}
    bus.step()
    assert port.servos[2]["Goal Position"] == 800
    with pytest.raises(GoalError):
        bus.command({"head_tilt_joint": Goal(TILT.upper + 1.01 * TICK)})


@pytest.mark.parametrize(("position", "ticks"), [(9.0, 800), (-9.0, 300)])
def test_clamping_is_reported(port, bus, position: float, ticks: int) -> None:
    result = bus.command({"head_tilt_joint": Goal(position)}, clamp=True)
    limit = TILT.position(ticks)
    assert result.positions == {"head_tilt_joint": limit}
    assert result.clamped == {"head_tilt_joint": limit - position}
    assert bus.statistics().clamped_commands == 1
    bus.step()
    assert port.servos[2]["Goal Position"] == ticks


def test_command_to_a_joint_relaxed_on_request_is_refused_with_the_remedy(
    port: FakePort, bus: ServoBus
) -> None:
    run(bus.switching_torque(["head_pan_joint"], False))
    with pytest.raises(GoalError, match=r"torque_enable"):
        bus.command({"head_pan_joint": Goal(0.1), "head_tilt_joint": Goal(0.1)})
    port.take_log()
    bus.step()
    assert writes(port.log) == []
    run(bus.switching_torque(["head_pan_joint"], True))
    bus.command({"head_pan_joint": Goal(0.1)})
    bus.step()
    assert port.servos[1]["Goal Position"] == PAN.ticks(0.1)


def test_lost_joint_does_not_stop_the_others(port, bus) -> None:
    port.servos[1].answers = False
    for _ in range(5):
        bus.step()
    goals = {"head_pan_joint": Goal(0.1), "head_tilt_joint": Goal(0.2)}
    with pytest.raises(GoalError, match="head_pan_joint"):  # all or none
        bus.command(goals)
    bus.step()
    assert not port.servos[2]["Torque Enable"]
    result = bus.command(goals, clamp=True)
    assert (set(result.left_out), set(result.positions)) == (
        {"head_pan_joint"},
        {"head_tilt_joint"},
    )
    port.take_log()
    bus.step()
    assert port.servos[2]["Goal Position"] == TILT.ticks(0.2)
    with pytest.raises(GoalError, match="head_pan_joint"):
        bus.command({"head_pan_joint": Goal(0.1)}, clamp=True)


@pytest.mark.parametrize("speed", [0.0, math.nan, math.inf])
def test_impossible_joint_speed_is_refused(speed: float) -> None:
    bus = connected(FakePort())
    with pytest.raises(GoalError, match="above 0"):
        bus.joint("head_pan_joint").set_default_speed(speed)
    assert bus.joint("head_pan_joint").default_speed == 2.0


# Commands that something overtakes after they were accepted


def test_a_command_that_closing_overtakes_moves_nothing_when_the_bus_is_connected_again(
    port: FakePort, bus: ServoBus
) -> None:
    bus.command({"head_pan_joint": Goal(0.5)}, claim=lambda _: bus.close())
    bus.connect()
    port.take_log()
    bus.step()
    assert writes(port.log) == []


def test_a_command_that_relaxing_overtakes_is_dropped_and_no_failure(
    port: FakePort, bus: ServoBus
) -> None:
    def relax(_: object) -> None:
        run(bus.switching_torque(["head_pan_joint"], False))

    bus.command({"head_pan_joint": Goal(0.5)}, claim=relax)
    assert [event.kind for event in bus.step().events] == [EventKind.TORQUE_OFF]
    run(bus.switching_torque(["head_pan_joint"], True))
    bus.step()
    assert port.servos[1]["Goal Position"] == 512
