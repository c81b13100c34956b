"""Two simulated servos and the bytes that go to and fro between them and a 50 Hz loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from head_tracking.dynamixel import JointConfiguration
from head_tracking.dynamixel.protocol import find_status, read_packet, sync_write_packet
from head_tracking.gaze import HeadCommand
from head_tracking.simulation import SimulatedBus, SimulatedServo

_BYTE = 10_000  # ns at 1 Mbit/s
_ADAPTER = 100_000  # ns for a packet to get onto the wire
_ANSWERED = 300_000  # ns for an answer to get off it

PAN = JointConfiguration("head_pan_joint", "head_pan_controller", 1)
TILT = JointConfiguration("head_tilt_joint", "head_tilt_controller", 2)


class SimulatedHead:
    """Pan and tilt on AX-12 servos. Time is passed in, as integer ns.

    Args:
        start: pan and tilt at first [rad].
        modify: is handed both servos, to make them others than an AX-12 usually is.
    """

    def __init__(
        self,
        start: tuple[float, float] = (0.0, 0.0),
        modify: Callable[[SimulatedServo], object] = lambda servo: None,
    ) -> None:
        self._joints = (PAN, TILT)
        self._servos = tuple(
            SimulatedServo(joint.id, position=joint.ticks(position))
            for joint, position in zip(self._joints, start, strict=True)
        )
        for servo in self._servos:
            modify(servo)
        self._bus = SimulatedBus(self._servos)
        self._command: HeadCommand | None = None
        self.goals: tuple[int, int] | None = None

    def command(self, command: HeadCommand) -> None:
        """Leaves a command for the next cycle."""
        self._command = command

    def cycle(self, now: int) -> tuple[int, tuple[float, float]]:
        """Reads both servos and then writes the newest goals, in one packet.

        Returns:
            When the servos were read, the middle of it [ns], and pan and tilt [rad].
        """
        time, stamps, positions = now, [], []
        for joint in self._joints:
            register = joint.model.control_table["Present Position"]
            sent = read_packet(1, joint.id, register.address, register.size)
            asked = time
            time += _ADAPTER + len(sent) * _BYTE
            (answer,) = self._bus.receive(sent, time)
            time += answer.delay + len(answer.data) * _BYTE + _ANSWERED
            status = find_status(1, answer.data).status
            assert status is not None
            stamps.append((asked + time) // 2)
            positions.append(joint.position(int.from_bytes(status.data, "little")))
        if self._command is not None:
            self._write(self._command, time + _ADAPTER)
        return sum(stamps) // 2, (positions[0], positions[1])

    def true_positions(self, now: int) -> tuple[float, float]:
        """Where pan and tilt really are [rad]."""
        self._bus.advance(now)
        pan, tilt = (
            joint.position(servo.true_ticks)
            for joint, servo in zip(self._joints, self._servos, strict=True)
        )
        return pan, tilt

    def _write(self, command: HeadCommand, now: int) -> None:
        block = PAN.model.goal
        ticks = PAN.ticks(command.pan), TILT.ticks(command.tilt)
        speeds = PAN.speed_ticks(command.pan_speed), TILT.speed_ticks(command.tilt_speed)
        shares: Mapping[int, bytes] = {
            joint.id: block.encode(tick, speed)
            for joint, tick, speed in zip(self._joints, ticks, speeds, strict=True)
        }
        packet = sync_write_packet(1, block.address, shares)
        self._bus.receive(packet, now + len(packet) * _BYTE)
        self.goals = ticks
