"""A robot of the package after a target: its model, servos, bus and tracker, in simulated time."""

from __future__ import annotations

import math
from statistics import mean

from simulated_device import PERIOD, Rig

from head_tracking.configuration import configured_head
from head_tracking.configuration.simulated import mounted_servos
from head_tracking.dynamixel import Goal
from head_tracking.dynamixel.servo import run
from head_tracking.gaze import PanTiltHead
from head_tracking.share import robot_file, robot_parameters
from head_tracking.tracking import LAWS, Tracker
from head_tracking.transforms import Vector3, load_robot_model

_LATE = 0.03  # s from when a target was somewhere until the tracker knows
_DISTANCE = 2.5  # m
_GROWS = 2.0  # s in which the swing grows, from rest


class Pursuit:
    """A target swings before a robot, and the head follows it.

    Args:
        name: of the robot.
        frequency: of the target [Hz].
        amplitude: of its azimuth [rad]; its elevation has a third of it, three times as slow.

    Attributes:
        errors: angle between camera and target in each cycle [rad].
    """

    def __init__(self, name: str, frequency: float, amplitude: float = 0.4) -> None:
        configured = configured_head(robot_parameters(name))
        self.servos = configured.servos
        names = [servo.joint_name for servo in self.servos]
        model = load_robot_model(robot_file(name))
        self.head = PanTiltHead(model, names[0], names[1], configured.pointing_frame)
        self._frequency, self._amplitude = frequency, amplitude
        straight = model.transform(
            self.head.base_frame, configured.pointing_frame, dict.fromkeys(names, 0.0)
        )
        self._origin = straight.translation
        self._ahead = straight @ (1.0, 0.0, 0.0)
        self._rig = Rig(*mounted_servos(self.servos), joints=self.servos)
        self._tracker = Tracker(self.head, LAWS["predictive"](self.head, PERIOD))
        self._begin = 0.0
        self.errors: list[float] = []

    def target(self, now: float) -> Vector3:
        """Return where the target is [m], in the base frame of the head, at a time [s]."""
        x, y, _ = (a - o for a, o in zip(self._ahead, self._origin, strict=True))
        since = now - self._begin
        turn = math.tau * self._frequency * since
        amplitude = self._amplitude * min(1.0, max(0.0, since) / _GROWS)
        azimuth = math.atan2(y, x) + amplitude * math.sin(turn)
        elevation = amplitude / 3.0 * math.sin(turn / 3.0)
        flat = _DISTANCE * math.cos(elevation)
        return (
            self._origin[0] + flat * math.cos(azimuth),
            self._origin[1] + flat * math.sin(azimuth),
            self._origin[2] + _DISTANCE * math.sin(elevation),
        )

    def run(self, seconds: float) -> Pursuit:
        """Track for some time."""
        rig, clock = self._rig, self._rig.bench.clock
        run(rig.bus.switching_torque(None, True), rig.bench.pass_time)  # as Head.follow does
        self._begin = clock()
        for cycle in range(round(seconds / PERIOD)):
            states = rig.step().states
            now = clock()
            if len(states) == 2:
                pan, tilt = (states[servo.joint_name] for servo in self.servos)
                stamp = 0.5e-9 * (pan.stamp + tilt.stamp)
                self._tracker.joints_read(stamp, (pan.position, tilt.position))
            if cycle * PERIOD >= _LATE:
                self._tracker.target_seen(now - _LATE, self.target(now - _LATE), now)
            command = self._tracker.step(now).command
            if command is not None:
                goals = (
                    Goal(command.pan, command.pan_speed),
                    Goal(command.tilt, command.tilt_speed),
                )
                joints = (servo.joint_name for servo in self.servos)
                rig.bus.command(dict(zip(joints, goals, strict=True)), clamp=True)
            self.errors.append(self.head.miss(self.target(now), *self._true_positions()))
        return self

    @property
    def rms(self) -> float:
        """The root mean square of all errors [rad]."""
        return math.sqrt(mean(error * error for error in self.errors))

    def _true_positions(self) -> tuple[float, float]:
        bus = self._rig.bench.bus
        pan, tilt = (servo.position(bus[servo.id].true_ticks) for servo in self.servos)
        return pan, tilt
