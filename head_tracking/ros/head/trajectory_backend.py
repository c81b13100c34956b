"""A head driven by a joint_trajectory_controller, as the backend of a control loop."""

from __future__ import annotations

import sys
import threading
from collections.abc import Mapping

from builtin_interfaces.msg import Duration
from rclpy.node import Node

from head_tracking.control import Controller, ControlLoop, JointBackend
from head_tracking.dynamixel import Goal
from head_tracking.gaze import HeadCommand
from head_tracking.ros.kit.head_claim import HeadClaim
from head_tracking.ros.kit.head_lock import HeadLock
from head_tracking.ros.kit.joint_owners import OwnersOutput, offer_stop
from head_tracking.ros.kit.message_types import message_class
from head_tracking.ros.kit.threads import UrgentServices
from head_tracking.tracking import JointReading, SetpointStream

_PERIOD = 0.02  # s


class TrajectoryBackend(JointBackend, Controller):
    """A `JointBackend`: streams trajectories of one point to a joint_trajectory_controller.

    It offers `stop` and `resume`. Only the robot's driver can relax the joints: `stop` ends the
    stream, holds the head, and reports that nothing is relaxed. It is also a controller of the
    loop, after that of the head, and continues the latest command. A simulated head with its names
    would move it, and ends.

    Args:
        node: controls the head.
        topic: of the joint_trajectory_controller.
        name: the owner of the joints.
        joints: pan and tilt.
        time_from_start: of each point [s].
        loop: of the process.

    Raises:
        MessagesMissingError: trajectory_msgs is not installed.
        RefusedError: another head is on this machine.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        name: str,
        joints: tuple[str, str],
        time_from_start: float,
        loop: ControlLoop,
    ) -> None:
        self._message = message_class("trajectory_msgs/msg/JointTrajectory")
        self._point = message_class("trajectory_msgs/msg/JointTrajectoryPoint")
        self._head_lock = HeadLock(sys.argv, simulated=False)
        self._head_lock.acquire(shared=True)
        HeadClaim(node, simulated=False).begin()
        self.name, self.joints = name, joints
        self._node = node
        self._stream = SetpointStream(_PERIOD, time_from_start)
        self._after = time_from_start
        self._publisher = node.create_publisher(self._message, topic, 10)
        self._lock = threading.Lock()
        self._loop = loop
        self._services = UrgentServices(node)
        OwnersOutput(node, loop.owners, joints)
        offer_stop(self._services, loop.stop, lambda: (loop.owners.resume(), {}), ("~/", ""))
        node.get_logger().info(
            f"the head is driven by {self._publisher.topic_name}; stop holds it and relaxes nothing"
        )

    def start(self) -> None:
        """See `JointBackend`."""
        self._services.start()
        self._loop.add(self)

    def close(self) -> None:
        """Withdraw the services; see `JointBackend`."""
        self._services.close()
        self._head_lock.release()

    def write(self, owner: str, goals: Mapping[str, Goal], epoch: int) -> None:
        """Publish positions on the way to new goals; see `JointBackend`."""
        pan, tilt = (goals[joint] for joint in self.joints)
        self._advance(
            HeadCommand(pan.position, tilt.position, pan.speed or 0.0, tilt.speed or 0.0), epoch
        )

    def update(self) -> None:
        """Publish the next positions on the way to the latest goals; see `Controller`."""
        if self._loop.owners.owns(self.name, self.joints):
            self._advance(None, self._loop.owners.epoch.value)
        else:
            with self._lock:
                self._stream.stop()

    def _advance(self, command: HeadCommand | None, epoch: int) -> None:
        measured = self._measured()
        now = self._node.get_clock().now().nanoseconds * 1e-9
        with self._lock:
            owners = self._loop.owners
            if measured is None or owners.stopped or epoch != owners.epoch.value:
                return
            positions = self._stream.positions(command, measured, now)
            if positions is not None:
                self._publish(positions)

    def _measured(self) -> JointReading | None:
        assert self._loop.buffer is not None
        pan, tilt = (self._loop.buffer.latest_joint_position(joint) for joint in self.joints)
        if pan is None or tilt is None:
            return None
        return JointReading(min(pan[0], tilt[0]) * 1e-9, (pan[1], tilt[1]))

    def _publish(self, positions: tuple[float, float]) -> None:
        seconds, rest = divmod(self._after, 1.0)
        point = self._point(
            positions=list(positions),
            time_from_start=Duration(sec=int(seconds), nanosec=round(rest * 1e9)),
        )
        # stamp 0: at once
        self._publisher.publish(self._message(joint_names=list(self.joints), points=[point]))

    def relax_now(self) -> Mapping[str, str]:
        """Hold the head, which cannot be relaxed from here; see `JointBackend`."""
        with self._lock:
            measured = self._measured()
            if measured is not None and self._stream.active:
                self._publish(measured.positions)
            self._stream.stop()
        topic = self._publisher.topic_name
        problem = f"{topic} was commanded to hold; only the driver of the robot can relax it"
        return dict.fromkeys(self.joints, problem)
