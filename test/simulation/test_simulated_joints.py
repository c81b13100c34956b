from waiting import wait_for

from head_tracking.configuration.simulated import SimulatedJoints
from head_tracking.dynamixel import (
    JointConfiguration,
    ServoCalibration,
)


def test_two_servos_of_a_joint_are_coupled():
    second = ServoCalibration("lift", 8, 500, 900, 100)
    joint = JointConfiguration("lift", 7, controller="lift_controller", second=second)
    joints = SimulatedJoints([joint])
    assert joints.use(lambda bus: [servo.id for servo in bus]) == [7, 8]
    joints.use(lambda bus: bus[7].lead(joint.ticks(0.5), 0.1))
    wait_for(lambda: abs(second.position(joints.use(lambda bus: bus[8].true_ticks)) - 0.5) < 0.06)
