"""Several buses that look like one."""

from __future__ import annotations

from dataclasses import replace

import pytest
from dynamixel_fakes import PAN, TILT, FakePort

from head_tracking.dynamixel import (
    Buses,
    BusReading,
    ConfigurationError,
    Epoch,
    Goal,
    GoalError,
    JointConfiguration,
    ServoBus,
    Torque,
)

PATIENCE = 10.0


def ignore(bus: ServoBus, reading: BusReading) -> None:
    del bus, reading


def make(*joints: JointConfiguration) -> tuple[Buses, list[FakePort]]:
    ports = [FakePort(joint.id) for joint in joints]
    epoch = Epoch()
    buses = [
        ServoBus(port, [joint], epoch=epoch) for port, joint in zip(ports, joints, strict=True)
    ]
    for bus in buses:
        bus.connect()
    return Buses(buses, 50.0, ignore, lambda error: None), ports


def test_command_reaches_the_bus_of_each_joint() -> None:
    buses, ports = make(PAN, TILT)
    result = buses.command({"head_pan_joint": Goal(0.1), "head_tilt_joint": Goal(9.0)}, clamp=True)
    assert set(result.positions) == {"head_pan_joint", "head_tilt_joint"}
    assert set(result.clamped) == {"head_tilt_joint"}
    for bus in [thread.bus for thread in buses.threads]:
        for _ in range(10):
            bus.step()
    assert ports[0].servos[1]["Goal Position"] == PAN.ticks(0.1)
    assert ports[1].servos[2]["Goal Position"] == 800
    buses.stop()


def test_unknown_joint_moves_nothing() -> None:
    buses, ports = make(PAN, TILT)
    with pytest.raises(GoalError, match="'elbow' on any bus; there are head_pan_joint, head_tilt"):
        buses.command({"head_pan_joint": Goal(0.1), "elbow": Goal(0.1)})
    for bus in [thread.bus for thread in buses.threads]:
        bus.step()
    assert ports[0].servos[1]["Torque Enable"] == 0
    buses.stop()


def test_refusal_of_one_bus_is_told_and_does_not_stop_the_other() -> None:
    buses, ports = make(PAN, TILT)
    with pytest.raises(GoalError, match="head_tilt_joint: goal position 9"):
        buses.command({"head_pan_joint": Goal(0.1), "head_tilt_joint": Goal(9.0)})
    for _ in range(10):
        buses.threads[0].bus.step()
    assert ports[0].servos[1]["Goal Position"] == PAN.ticks(0.1)
    buses.stop()


def test_request_runs_in_the_thread_of_each_bus_with_its_share() -> None:
    buses, ports = make(PAN, TILT)
    buses.start()
    for future in buses.call(None, lambda bus, joints: bus.run(bus.switching_torque(joints, True))):
        future.result(PATIENCE)
    assert buses.torque("head_pan_joint") is buses.torque("head_tilt_joint") is Torque.ON
    (future,) = buses.call(["head_tilt_joint"], lambda bus, joints: joints)
    assert future.result(PATIENCE) == ("head_tilt_joint",)
    with pytest.raises(GoalError):
        buses.call(["elbow"], lambda bus, joints: joints)
    assert buses.stop() == ()
    assert [port.opened for port in ports] == [False, False]


def test_same_joint_or_controller_on_two_buses_is_refused() -> None:
    other = replace(TILT, joint_name="head_pan_joint")
    same = replace(TILT, controller=PAN.controller)
    for joint in (other, same):
        epoch = Epoch()
        buses = [ServoBus(FakePort(), [each], epoch=epoch) for each in (PAN, joint)]
        with pytest.raises(ConfigurationError, match="on two buses"):
            Buses(buses, 50.0, ignore, lambda error: None)
