"""Heads that a joint trajectory controller drives, late, instead of our servo bus."""

from __future__ import annotations

from collections import deque

from closed_loop import PAN, TILT, SimulatedHead
from dynamixel_fakes import speed_ticks
from plant import JointsRead, Make

from head_tracking.dynamixel.protocol import sync_write_packet
from head_tracking.gaze import HeadCommand
from head_tracking.tracking import SetpointStream

_CYCLE = 10_000_000  # ns: 100 Hz
_FASTEST = 6.0  # rad/s
_PERIOD = 0.02  # s
_BYTE = 10_000  # ns


class TrajectoryFollower:
    """One joint of a joint_trajectory_controller, with one waypoint at a time; times in ns.

    Args:
        position: where it stands [rad].
        delay: from a message to its effect.
        from_measured: a new trajectory begins where the joint was measured, as with the
            controller's defaults; else where it is meant to be (`open_loop_control`, or
            `interpolate_from_desired_state`).
    """

    def __init__(self, position: float, delay: int, *, from_measured: bool) -> None:
        self.desired = position
        self._delay = delay
        self._from_measured = from_measured
        self._messages: deque[tuple[int, float, int]] = deque()
        self._begin, self._start, self._end, self._goal = 0, position, 0, position

    def trajectory(self, now: int, goal: float, duration: int) -> None:
        """Takes a message with one point: a goal [rad] and its `time_from_start` [ns]."""
        self._messages.append((now + self._delay, goal, duration))

    def update(self, now: int, measured: float) -> float:
        """The position that the hardware is told [rad]."""
        newest = None
        while self._messages and self._messages[0][0] <= now:
            newest = self._messages.popleft()
        if newest is not None:
            _, self._goal, duration = newest
            self._begin, self._end = now, now + duration
            self._start = measured if self._from_measured else self.desired
        if now >= self._end:
            self.desired = self._goal
        else:
            share = (now - self._begin) / (self._end - self._begin)
            self.desired = self._start + share * (self._goal - self._start)
        return self.desired


class FollowedHead(SimulatedHead):
    """The servos of a `SimulatedHead` behind a trajectory controller.

    Args:
        start: pan and tilt at first [rad].
        time_from_start: of each message [s].
        delay: from a message to its effect [s].
        from_measured: see `TrajectoryFollower`.
    """

    def __init__(
        self, start: tuple[float, float], time_from_start: float, delay: float, from_measured: bool
    ) -> None:
        super().__init__(start)
        self._duration = round(time_from_start * 1e9)
        self._stream = SetpointStream(_PERIOD, time_from_start)
        self._followers = tuple(
            TrajectoryFollower(position, round(delay * 1e9), from_measured=from_measured)
            for position in start
        )
        self._updated = 0
        self._read = start

    def read(self, now: int) -> JointsRead:
        """Joint states from elsewhere."""
        self._advance(now)
        read = super().read(now)
        self._read = read.positions
        return read

    def write(self, command: HeadCommand, now: int) -> None:
        """What the output of a node that turns a head does with a command."""
        positions = self._stream.positions(command, self._read, now * 1e-9)
        if positions is not None:
            for follower, position in zip(self._followers, positions, strict=True):
                follower.trajectory(now, position, self._duration)

    def true_positions(self, now: int) -> tuple[float, float]:
        """Where pan and tilt really are [rad]."""
        self._advance(now)
        return super().true_positions(now)

    def _advance(self, now: int) -> None:
        while self._updated + _CYCLE <= now:
            self._updated += _CYCLE
            measured = super().true_positions(self._updated)
            block, shares = PAN.model.goal, {}
            for joint, follower, position in zip(
                (PAN, TILT), self._followers, measured, strict=True
            ):
                told = follower.update(self._updated, joint.position(joint.ticks(position)))
                shares[joint.id] = block.encode(joint.ticks(told), speed_ticks(joint, _FASTEST))
            packet = sync_write_packet(1, block.address, shares)
            self._bus.receive(packet, self._updated + len(packet) * _BYTE)


def followed(
    time_from_start: float = 0.0, delay: float = 0.05, *, from_measured: bool = True
) -> Make:
    """AX-12 servos behind a 100 Hz trajectory controller that is late."""
    return lambda start: FollowedHead(start, time_from_start, delay, from_measured)
