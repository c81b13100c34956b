"""A head that another controller drives: commands as joint_trajectory, and STOP without servos."""

from __future__ import annotations

import threading
from collections.abc import Sequence

from rclpy.node import Node

from head_tracking.control import ControlLoop
from head_tracking.exceptions import HeadTrackingError
from head_tracking.gaze import HeadCommand
from head_tracking.ros.joint_owners import OwnersOutput, offer_stop
from head_tracking.ros.own_thread import OwnThread
from head_tracking.tracking import SetpointStream

try:
    from builtin_interfaces.msg import Duration
    from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
except ImportError:
    JointTrajectory = JointTrajectoryPoint = None

_PERIOD = 0.02  # s


class TrajectoryOutput:
    """Streams trajectories of one point to a joint_trajectory_controller.

    Nobody but that controller can relax the joints; so `stop` and `resume`, which it offers in the
    place of a servo bus, stop what is said here, hold the head, and say that nothing is relaxed.
    They have an executor and a thread of their own.

    Args:
        node: turns the head.
        topic: of the controller.
        joints: pan and tilt.
        time_from_start: of each point [s].
        loop: of the process.

    Raises:
        HeadTrackingError: trajectory_msgs is not installed.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        joints: Sequence[str],
        time_from_start: float,
        loop: ControlLoop,
    ) -> None:
        if JointTrajectory is None:
            raise HeadTrackingError(
                "command_interface is joint_trajectory, but trajectory_msgs is not installed "
                "(ros-jazzy-trajectory-msgs)"
            )
        self._joints = tuple(joints)
        self._stream = SetpointStream(_PERIOD, time_from_start)
        self._after = time_from_start
        self._publisher = node.create_publisher(JointTrajectory, topic, 10)
        self._measured: tuple[float, float] | None = None
        self._lock = threading.Lock()
        self._loop = loop
        self._own = OwnThread(node, f"{node.get_name()}_stop")
        OwnersOutput(self._own.node, loop.owners, joints)
        offer_stop(self._own.node, self._stop, loop.owners.resume)
        self._own.start()

    @property
    def topic(self) -> str:
        """Where the controller listens."""
        return str(self._publisher.topic_name)

    def close(self) -> None:
        """Offers nothing any more."""
        self._own.close()

    def take(self, command: HeadCommand | None, measured: tuple[float, float], now: float) -> None:
        """Takes a command, or lets the last one go on.

        Args:
            command: for both joints.
            measured: where they are [rad].
            now: the time [s].
        """
        with self._lock:
            self._measured = measured
            if self._loop.owners.stopped:
                return
            positions = self._stream.positions(command, measured, now)
            if positions is not None:
                self._publish(positions)

    def hold(self) -> None:
        """Ends what is under way where the head is, and says nothing more until a command."""
        with self._lock:
            if self._measured is not None and self._stream.active:
                self._publish(self._measured)
            self._stream.stop()

    def _publish(self, positions: tuple[float, float]) -> None:
        seconds, rest = divmod(self._after, 1.0)
        point = JointTrajectoryPoint(
            positions=list(positions),
            time_from_start=Duration(sec=int(seconds), nanosec=round(rest * 1e9)),
        )
        # stamp 0: at once, by the controller's own clock
        self._publisher.publish(JointTrajectory(joint_names=list(self._joints), points=[point]))

    def _stop(self) -> dict[str, str]:
        self._loop.owners.stop(self.hold)
        problem = f"{self.topic} was told to hold, and nothing else is sent; it was not relaxed"
        return dict.fromkeys(self._joints, problem)
