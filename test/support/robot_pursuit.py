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
_FREQUENCY, _AMPLITUDE = 0.5, 0.4  # Hz, rad of pan; tilt has a third of both
_GROWS = 2.0  # s in which the swing grows, from rest


class Pursuit:
    """A target swings before a robot, and the head follows it."""

    def __init__(self, name: str) -> None:
        configured = configured_head(robot_parameters(name))
        self.servos = configured.servos
        self._names = [servo.joint_name for servo in self.servos]
        self._model = load_robot_model(robot_file(name))
        self._frame = configured.pointing_frame
        self.head = PanTiltHead(self._model, *self._names, self._frame)
        self._rig = Rig(*mounted_servos(self.servos), joints=self.servos)
        self._tracker = Tracker(self.head, LAWS["predictive"](self.head, PERIOD))
        self._begin = 0.0
        self.errors: list[float] = []  # angle between camera and target in each cycle [rad]

    def target(self, now: float) -> Vector3:
        """Return where the target is [m], in the base frame of the head, at a time [s]."""
        since = max(0.0, now - self._begin)
        swing = _AMPLITUDE * min(1.0, since / _GROWS)
        pan = swing * math.sin(math.tau * _FREQUENCY * since)
        tilt = swing / 3.0 * math.sin(math.tau * _FREQUENCY * since / 3.0)
        looking_there = dict(zip(self._names, (pan, tilt), strict=True))
        pose = self._model.transform(self.head.base_frame, self._frame, looking_there)
        return pose @ (_DISTANCE, 0.0, 0.0)

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
