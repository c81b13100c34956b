import pytest
from waiting import wait_for

from head_tracking.configuration.simulated import SimulatedJoints
from head_tracking.dynamixel import (
    DynamixelPort,
    Goal,
    JointConfiguration,
    ServoBus,
    ServoCalibration,
)

JOINTS = (
    JointConfiguration("pan", 3, controller="pan_controller"),
    JointConfiguration("tilt", 5, controller="tilt_controller", init=600, min=800, max=300),
)


def test_the_driver_moves_a_reversed_joint():
    joints = SimulatedJoints(JOINTS)
    bus = ServoBus(DynamixelPort("simulated", open_device=joints.open), JOINTS)
    assert bus.connect() == "2 AX-12 servos: ids 3, 5"
    bus.command({"tilt": Goal(0.6)})
    velocities = []

    def arrives():
        velocities.append(bus.step().states["tilt"].velocity)
        return abs(joints.true_position("tilt") - 0.6) < 0.01

    wait_for(arrives)
    assert max(velocities) > 0.3
    assert bus.step().states["tilt"].position == pytest.approx(0.6, abs=0.015)
    assert joints.true_position("pan") == pytest.approx(0.0, abs=1e-9)
    assert bus.close() == ()


def test_two_servos_of_a_joint_are_coupled():
    second = ServoCalibration("lift", 8, 500, 900, 100)
    joint = JointConfiguration("lift", 7, controller="lift_controller", second=second)
    joints = SimulatedJoints([joint])
    assert joints.use(lambda bus: [servo.id for servo in bus]) == [7, 8]
    joints.use(lambda bus: bus[7].lead(joint.ticks(0.5), 0.1))
    wait_for(lambda: abs(second.position(joints.use(lambda bus: bus[8].true_ticks)) - 0.5) < 0.06)
