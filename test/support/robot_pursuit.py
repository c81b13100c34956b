"""A robot of the package after a target: its model, servos, bus and tracker, in simulated time."""

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


def pursue(name: str, seconds: float) -> float:
    """Follow a target that swings before a robot; return the rms of the true errors [rad]."""
    configured, model = configured_head(robot_parameters(name)), load_robot_model(robot_file(name))
    servos, frame = configured.servos, configured.pointing_frame
    names = [servo.joint_name for servo in servos]
    head = PanTiltHead(model, *names, frame)
    tracker = Tracker(head, LAWS["predictive"](head, PERIOD))
    rig = Rig(*mounted_servos(servos), joints=servos)
    run(rig.bus.switching_torque(None, True), rig.bench.pass_time)  # as Head.follow does
    begin = rig.bench.clock()

    def target(now: float) -> Vector3:
        since = max(0.0, now - begin)
        swing = _AMPLITUDE * min(1.0, since / _GROWS)
        pan = swing * math.sin(math.tau * _FREQUENCY * since)
        tilt = swing / 3.0 * math.sin(math.tau * _FREQUENCY * since / 3.0)
        looking_there = dict(zip(names, (pan, tilt), strict=True))
        return model.transform(head.base_frame, frame, looking_there) @ (_DISTANCE, 0.0, 0.0)

    errors = []
    for cycle in range(round(seconds / PERIOD)):
        states = rig.step().states
        now = rig.bench.clock()
        if len(states) == 2:
            pan, tilt = (states[name] for name in names)
            tracker.joints_read(0.5e-9 * (pan.stamp + tilt.stamp), (pan.position, tilt.position))
        if cycle * PERIOD >= _LATE:
            tracker.target_seen(now - _LATE, target(now - _LATE), now)
        command = tracker.step(now).command
        if command is not None:
            goals = Goal(command.pan, command.pan_speed), Goal(command.tilt, command.tilt_speed)
            rig.bus.command(dict(zip(names, goals, strict=True)), clamp=True)
        true = (servo.position(rig.bench.bus[servo.id].true_ticks) for servo in servos)
        errors.append(head.miss(target(now), *true))
    return math.sqrt(mean(error * error for error in errors))
