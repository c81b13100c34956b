"""Simulated servos for configured joints."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from head_tracking.dynamixel import Adapter, JointConfiguration, ServoCalibration
from head_tracking.simulation import (
    SimulatedBus,
    SimulatedLine,
    SimulatedServo,
    SteadyClock,
)
from head_tracking.simulation.models import simulated_model

if TYPE_CHECKING:
    from typing import Self


class SimulatedJoints(SimulatedLine):
    """Simulated servos for configured joints, in place of a serial device of this process.

    Joints start at position 0. Two servos of one joint are coupled.
    """

    adapter = Adapter()

    def __init__(self, joints: Iterable[JointConfiguration]) -> None:
        self._joints = {joint.joint_name: joint for joint in joints}
        super().__init__(mounted_servos(self._joints.values()), SteadyClock())

    def open(self, _: str, baud_rate: int) -> Self:
        """Return itself, at another baud rate; see `DynamixelPort`."""
        self._baud_rate = baud_rate
        return self

    def true_position(self, joint_name: str) -> float:
        """Return the exact position of a joint behind all play, rad."""
        joint = self._joints[joint_name]
        servo_id = joint.calibrations[0].id
        return joint.position(self.use(lambda bus: bus[servo_id].true_ticks))

    def set_link_play(self, play: float) -> None:
        """Set the play of all joints between encoder and link, rad from side to side."""
        for servo in self.bus:
            servo.drive.mechanics.link_play = play


def mounted_servos(joints: Iterable[JointConfiguration]) -> SimulatedBus:
    """Return a bus with the servos of joints, each joint at position 0."""
    pairs = [joint.calibrations for joint in joints]
    bus = SimulatedBus([_servo(mount) for mounts in pairs for mount in mounts])
    for mounts in pairs:
        if len(mounts) == 2:
            one, other = mounts
            bus.couple(one.id, other.id, _rotation(one) * _rotation(other))
    return bus


def _servo(mount: ServoCalibration) -> SimulatedServo:
    """Return a servo at position 0 of its joint, with the configured EEPROM."""
    model, init = simulated_model(mount.model.name), mount.init
    if mount.offset and model.is_feetech:
        init = (init + mount.offset) % model.ticks
    elif mount.offset and model.control == "profile":
        init -= mount.offset
    position = 2 * model.center - init if mount.reverse else init
    servo = SimulatedServo(mount.id, mount.model, position=position)
    if mount.reverse:
        servo.set_register("Drive Mode", 1)
    if mount.offset:
        servo.set_offset(mount.offset)
    return servo


def _rotation(mount: ServoCalibration) -> int:
    """Return 1 if the shaft turns counter-clockwise for rising joint positions, else -1."""
    return -mount.direction if mount.reverse else mount.direction
