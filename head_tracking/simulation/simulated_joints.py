"""The servos of a configuration, simulated: a port to open, and the truth about the joints."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Self

from head_tracking.dynamixel.configuration import JointConfiguration
from head_tracking.simulation.servo import SimulatedServo
from head_tracking.simulation.simulated_port import SimulatedPort


class SimulatedJoints:
    """The servos of each joint, at position 0, behind one port. A context manager.

    Two servos on one joint turn each for itself: no shaft joins them.

    Attributes:
        port: the port of the bus that they share.
    """

    def __init__(self, joints: Iterable[JointConfiguration]) -> None:
        self._joints = {joint.joint_name: joint for joint in joints}
        self.port = SimulatedPort(
            SimulatedServo(mount.id, mount.model, position=mount.init)
            for joint in self._joints.values()
            for mount in joint.mounts
        )

    @property
    def port_name(self) -> str:
        """What a driver opens."""
        return self.port.port_name

    def true_position(self, joint_name: str) -> float:
        """Where the joint really is [rad], finer than any encoder tells."""
        joint = self._joints[joint_name]
        return joint.position(self.port.true_ticks(joint.id))

    def lead(self, joint_name: str, position: float, duration: float) -> None:
        """Lets a hand lead the joint to a position [rad] within `duration` [s]."""
        for mount in self._joints[joint_name].mounts:
            self.port.lead(mount.id, mount.ticks(position), duration)

    def __enter__(self) -> Self:
        self.port.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.port.close()
