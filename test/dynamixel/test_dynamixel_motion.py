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
    Packet,
    connected,
    goal_bytes,
    speed_ticks,
    writes,
)

from head_tracking.dynamixel import (
    EventKind,
    Goal,
    GoalError,
    ReplyTimeoutError,
    ServoBus,
    Torque,
    TorqueError,
)
from head_tracking.dynamixel.protocol import ErrorBits
from head_tracking.dynamixel.servo import run

ON, OFF = b"\x01", b"\x00"
TICK = PAN.resolution


def pin(servo_id: int, ticks: int) -> list[Packet]:
    """The only way to switch torque on."""
    return [
        ("read", servo_id, 6, 4),  # is it in position mode?
        ("read", servo_id, 36, 2),
        ("write", servo_id, GOAL, goal_bytes(ticks, 1)),
        ("read", servo_id, GOAL, 4),
        ("write", servo_id, TORQUE, ON),
        ("read", servo_id, TORQUE, 1),
        ("read", servo_id, 36, 2),  # does it move?
    ]


# Torque


def test_first_command_pins_the_servo_before_it_moves() -> None:
    port = FakePort()
    port.servos[1]["Present Position"] = 450
    bus = connected(port)
    bus.command({"head_pan_joint": Goal(0.5, 1.0)})
    assert port.log == []
    bus.step()
    assert port.log == [
        ("read", 1, 36, 8),
        ("read", 2, 36, 8),
        *pin(1, 450),
        ("sync", GOAL, {1: goal_bytes(PAN.ticks(0.5), speed_ticks(PAN, 1.0))}),
    ]
    assert bus.joint("head_pan_joint").torque is Torque.ON
    assert bus.joint("head_tilt_joint").torque is Torque.OFF_UNTIL_COMMANDED


def test_torque_on_holds_the_present_position() -> None:
    port = FakePort()
    port.servos[1]["Present Position"] = 450
    bus = connected(port)
    run(bus.switching_torque(["head_pan_joint"], True))
    assert port.take_log() == pin(1, 450)
    reading = bus.step()
    assert writes(port.log) == [("sync", GOAL, {1: goal_bytes(450, 1)})]
    assert reading.states["head_pan_joint"].goal == PAN.position(450)
    assert [event.kind for event in reading.events] == [EventKind.TORQUE_ON]


def test_goal_of_the_moment_before_torque_off_is_dropped(port, bus) -> None:
    bus.command({"head_pan_joint": Goal(0.5)})
    run(bus.switching_torque(["head_pan_joint"], False))
    run(bus.switching_torque(["head_pan_joint"], True))
    assert bus.step().states["head_pan_joint"].goal == PAN.position(512)
    assert port.servos[1]["Goal Position"] == 512
    run(bus.switching_torque(["head_pan_joint"], False))
    assert bus.step().states["head_pan_joint"].goal is None


def test_nothing_is_written_to_a_relaxed_servo(port, bus) -> None:
    bus.command({"head_pan_joint": Goal(0.5), "head_tilt_joint": Goal(0.1)})
    bus.step()
    run(bus.switching_torque(["head_pan_joint"], False))
    port.take_log()
    bus.joint("head_pan_joint").set_default_speed(1.0)
    for _ in range(3):
        bus.step()
    assert all(set(packet[2]) == {2} for packet in writes(port.log))  # type: ignore[call-overload]
    assert port.servos[1]["Torque Enable"] == 0


@pytest.mark.parametrize(("present", "goal"), [(250, 300), (900, 800)])
def test_servo_outside_its_limits_is_pinned_to_the_limit_at_the_lowest_speed(
    present: int, goal: int
) -> None:
    port = FakePort()
    port.servos[2]["Present Position"] = present
    bus = connected(port)
    run(bus.switching_torque(["head_tilt_joint"], True))
    assert writes(port.log)[0] == ("write", 2, GOAL, goal_bytes(goal, 1))


def test_servo_that_refuses_torque_is_left_relaxed(port, bus) -> None:
    port.servos[1].error = ErrorBits.ANGLE_LIMIT
    with pytest.raises(TorqueError, match=r"head_pan_joint: .*refused Goal Position.*angle limit"):
        run(bus.switching_torque(None, True))
    assert port.servos[1]["Torque Enable"] == 0
    assert bus.joint("head_pan_joint").torque is Torque.OFF_UNTIL_COMMANDED
    assert bus.joint("head_tilt_joint").torque is Torque.ON


def test_servo_that_keeps_its_old_goal_is_not_switched_on(port, bus) -> None:
    port.servos[1].ignored.add(GOAL)
    with pytest.raises(TorqueError, match="Goal Position"):
        run(bus.switching_torque(["head_pan_joint"], True))
    assert ("write", 1, TORQUE, ON) not in port.log


def test_command_to_a_servo_that_refuses_torque_is_dropped_and_reported(
    port: FakePort, bus: ServoBus
) -> None:
    port.servos[1].error = ErrorBits.RANGE
    bus.command({"head_pan_joint": Goal(0.5)})
    events = bus.step().events
    assert [(event.kind, event.joint_name) for event in events] == [
        (EventKind.TORQUE_FAILED, "head_pan_joint")
    ]
    assert bus.step().events == ()
    assert port.servos[1]["Torque Enable"] == 0


def test_torque_of_a_lost_servo(port, bus) -> None:
    port.servos[1].answers = False
    for _ in range(5):
        bus.step()
    with pytest.raises(TorqueError, match="does not answer"):
        run(bus.switching_torque(["head_pan_joint"], True))
    port.take_log()
    with pytest.raises(TorqueError, match="does not answer"):
        run(bus.switching_torque(["head_pan_joint"], False))
    assert port.log == [("sync", TORQUE, {1: OFF})]  # tried all the same


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


@pytest.mark.parametrize("speed", [1e-12, 1e-3, 5e-3])
def test_slow_is_never_zero_on_the_wire(port, bus, speed: float) -> None:
    bus.command({"head_pan_joint": Goal(0.5, speed)})
    bus.step()
    assert port.servos[1]["Moving Speed"] == 1


@pytest.mark.parametrize("speed", [50.0, 1e308])
def test_fast_is_capped_at_the_speed_limit(speed: float) -> None:
    port = FakePort(1)
    joint = replace(PAN, joint_speed=0.5, max_speed=1.0)
    bus = connected(port, joint)
    bus.command({"head_pan_joint": Goal(0.5, speed)})
    bus.step()
    assert port.servos[1]["Moving Speed"] == 86


@pytest.mark.parametrize(
    ("goals", "message"),
    [
        ({"head_pan_joint": Goal(math.nan)}, "head_pan_joint: goal position nan"),
        ({"head_pan_joint": Goal(math.inf)}, "goal position inf"),
        ({"head_pan_joint": Goal(0.1, 0.0)}, r"speed 0.0 rad/s refused.*above 0"),
        ({"head_pan_joint": Goal(0.1, -1.0)}, "speed -1.0"),
        ({"head_pan_joint": Goal(0.1, math.nan)}, "speed nan"),
        ({"head_pan_joint": Goal(0.1, math.inf)}, "speed inf"),
        ({"elbow": Goal(0.1)}, "no joint 'elbow'"),
        ({"head_tilt_joint": Goal(2.0)}, r"2.0000 rad refused; allowed are -1.0840 to 1.4726"),
        ({"head_pan_joint": Goal(0.1), "head_tilt_joint": Goal(-2.0)}, "head_tilt_joint"),
    ],
)
@pytest.mark.parametrize("clamp", [False, True])
def test_bad_command_is_refused_and_nothing_moves(
    goals: dict[str, Goal], message: str, clamp: bool
) -> None:
    if clamp and "head_tilt_joint" in goals:
        clamp = False  # a position outside the limits is allowed with clamp
    port = FakePort()
    bus = connected(port)
    with pytest.raises(GoalError, match=message):
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


@pytest.mark.parametrize("speed", [0.0, -1.0, math.nan, math.inf])
def test_impossible_joint_speed_is_refused(speed: float) -> None:
    bus = connected(FakePort())
    with pytest.raises(GoalError, match="above 0"):
        bus.joint("head_pan_joint").set_default_speed(speed)
    assert bus.joint("head_pan_joint").default_speed == 2.0


# Stopping


def test_close_repeats_a_lost_torque_off(port, bus) -> None:
    bus.command({"head_pan_joint": Goal(0.5)})
    bus.step()
    port.failures[1].extend([None, ReplyTimeoutError("late"), ReplyTimeoutError("late")])
    assert bus.close() == ()
    assert port.servos[1]["Torque Enable"] == 0


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
