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
    FakeRig,
    goal_bytes,
    speed_ticks,
    writes,
)

from head_tracking.dynamixel import (
    EventKind,
    Goal,
    GoalError,
    Torque,
    TorqueError,
)
from head_tracking.dynamixel.protocol import ErrorBits
from head_tracking.dynamixel.servo import run

TICK = PAN.resolution


# Torque


def test_the_first_command_holds_the_servo_where_it_stands_before_it_moves() -> None:
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


def test_goal_of_the_moment_before_torque_off_is_dropped(rig: FakeRig) -> None:
    rig.bus.command({"head_pan_joint": Goal(0.5)})
    run(rig.bus.switching_torque(["head_pan_joint"], False))
    run(rig.bus.switching_torque(["head_pan_joint"], True))
    assert rig.step().states["head_pan_joint"].goal == PAN.position(512)
    assert rig.pan["Goal Position"] == 512
    run(rig.bus.switching_torque(["head_pan_joint"], False))
    assert rig.step().states["head_pan_joint"].goal is None


@pytest.mark.parametrize(("present", "goal"), [(250, 300), (900, 800)])
def test_servo_outside_its_limits_is_pinned_to_the_limit_at_the_lowest_speed(
    present: int, goal: int
) -> None:
    rig = FakeRig(connect=False)
    rig.tilt["Present Position"] = present
    rig.connect()
    run(rig.bus.switching_torque(["head_tilt_joint"], True))
    assert writes(rig.log)[0] == ("write", 2, GOAL, goal_bytes(goal, 1))


@pytest.mark.parametrize("ignored", [False, True], ids=["refuses", "keeps its old goal"])
def test_servo_that_does_not_take_the_goal_is_left_relaxed(rig: FakeRig, ignored: bool) -> None:
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


def test_torque_of_a_lost_servo(rig: FakeRig) -> None:
    rig.pan.answers = False
    rig.step(5)
    with pytest.raises(TorqueError, match="does not answer"):
        run(rig.bus.switching_torque(["head_pan_joint"], True))
    rig.take_log()
    with pytest.raises(TorqueError):
        run(rig.bus.switching_torque(["head_pan_joint"], False))
    assert rig.log[0] == ("sync", TORQUE, {1: b"\0"})  # tried all the same


def test_torque_of_an_unknown_joint_switches_nothing(rig: FakeRig) -> None:
    with pytest.raises(GoalError, match=r"no joint 'elbow'.*head_pan_joint, head_tilt_joint"):
        run(rig.bus.switching_torque(["head_pan_joint", "elbow"], True))
    assert rig.log == []


# Commands


def test_goals_of_all_joints_go_out_in_one_packet_and_are_repeated(rig: FakeRig) -> None:
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


def test_goal_without_speed_uses_the_joints_speed(rig: FakeRig) -> None:
    rig.bus.command({"head_pan_joint": Goal(0.5)})
    rig.step(2)
    assert rig.pan["Moving Speed"] == speed_ticks(PAN, 2.0)
    rig.bus.joint("head_pan_joint").set_default_speed(0.5)
    assert rig.bus.joint("head_pan_joint").default_speed == 0.5
    rig.step(2)
    assert rig.pan["Moving Speed"] == speed_ticks(PAN, 0.5)


@pytest.mark.parametrize(("speed", "ticks"), [(1e-12, 1), (5e-3, 1), (50.0, 86), (1e308, 86)])
def test_speeds_are_neither_zero_on_the_wire_nor_above_the_limit(speed: float, ticks: int) -> None:
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
def test_bad_command_is_refused_and_nothing_moves(goals: dict[str, Goal], clamp: bool) -> None:
    rig = FakeRig()
    with pytest.raises(GoalError):
        rig.bus.command(goals, clamp=clamp)
    rig.step()
    assert writes(rig.log) == []
    assert rig.bus.statistics().refused_commands == 1


def test_one_tick_beyond_the_limit_counts_as_on_the_limit(rig: FakeRig) -> None:
    result = rig.bus.command({"head_tilt_joint": Goal(TILT.upper + 0.99 * TICK)})
    assert result.goals == {"head_tilt_joint": Goal(TILT.upper)}
    assert not result.clamped
    rig.step(2)
    assert rig.tilt["Goal Position"] == 800
    with pytest.raises(GoalError):
        rig.bus.command({"head_tilt_joint": Goal(TILT.upper + 1.01 * TICK)})


@pytest.mark.parametrize(("position", "ticks"), [(9.0, 800), (-9.0, 300)])
def test_clamping_is_reported(rig: FakeRig, position: float, ticks: int) -> None:
    result = rig.bus.command({"head_tilt_joint": Goal(position)}, clamp=True)
    limit = TILT.position(ticks)
    assert result.goals == {"head_tilt_joint": Goal(limit)}
    assert result.clamped == ["head_tilt_joint"]
    assert rig.bus.statistics().clamped_commands == 1
    rig.step(2)
    assert rig.tilt["Goal Position"] == ticks


def test_command_to_a_joint_relaxed_on_request_is_refused_with_the_remedy(rig: FakeRig) -> None:
    run(rig.bus.switching_torque(["head_pan_joint"], False))
    with pytest.raises(GoalError, match=r"torque_enable"):
        rig.bus.command({"head_pan_joint": Goal(0.1), "head_tilt_joint": Goal(0.1)})
    rig.take_log()
    rig.step()
    assert writes(rig.log) == []
    run(rig.bus.switching_torque(["head_pan_joint"], True))
    rig.bus.command({"head_pan_joint": Goal(0.1)})
    rig.step()
    assert rig.pan["Goal Position"] == PAN.ticks(0.1)


def test_lost_joint_does_not_stop_the_others(rig: FakeRig) -> None:
    rig.pan.answers = False
    rig.step(5)
    goals = {"head_pan_joint": Goal(0.1), "head_tilt_joint": Goal(0.2)}
    with pytest.raises(GoalError, match="head_pan_joint"):  # all or none
        rig.bus.command(goals)
    rig.step(2)
    assert not rig.tilt["Torque Enable"]
    result = rig.bus.command(goals, clamp=True)
    assert (set(result.left_out), set(result.goals)) == (
        {"head_pan_joint"},
        {"head_tilt_joint"},
    )
    rig.take_log()
    rig.step(2)
    assert rig.tilt["Goal Position"] == TILT.ticks(0.2)
    with pytest.raises(GoalError, match="head_pan_joint"):
        rig.bus.command({"head_pan_joint": Goal(0.1)}, clamp=True)


@pytest.mark.parametrize("speed", [0.0, math.nan, math.inf])
def test_impossible_joint_speed_is_refused(speed: float) -> None:
    bus = FakeRig().bus
    with pytest.raises(GoalError, match="above 0"):
        bus.joint("head_pan_joint").set_default_speed(speed)
    assert bus.joint("head_pan_joint").default_speed == 2.0


# Commands that something overtakes after they were accepted


def test_a_command_that_closing_overtakes_moves_nothing_when_the_bus_is_connected_again(
    rig: FakeRig,
) -> None:
    rig.bus.command({"head_pan_joint": Goal(0.5)}, claim=lambda _: rig.bus.close())
    rig.bus.connect()
    rig.take_log()
    rig.step()
    assert writes(rig.log) == []


def test_a_command_that_relaxing_overtakes_is_dropped_and_no_failure(rig: FakeRig) -> None:
    def relax(_: object) -> None:
        run(rig.bus.switching_torque(["head_pan_joint"], False))

    rig.bus.command({"head_pan_joint": Goal(0.5)}, claim=relax)
    assert [event.kind for event in rig.step().events] == [EventKind.TORQUE_OFF]
    run(rig.bus.switching_torque(["head_pan_joint"], True))
    rig.step()
    assert rig.pan["Goal Position"] == 512
