import time

from head_tracking.dynamixel import (
    JointConfiguration,
    ServoCalibration,
)
from head_tracking.simulation import SimulatedJoints


def test_two_servos_of_a_joint_are_coupled():
    second = ServoCalibration("lift", 8, 500, 900, 100)
    joint = JointConfiguration("lift", 7, controller="lift_controller", second=second)
    with SimulatedJoints([joint]) as joints:
        assert joints.port.use(lambda bus: [servo.id for servo in bus]) == [7, 8]
        joints.port.lead(7, joint.ticks(0.5), 0.1)
        deadline = time.monotonic() + 10
        while abs(second.position(joints.port.true_ticks(8)) - 0.5) > 0.03:
            assert time.monotonic() < deadline
            time.sleep(0.01)
