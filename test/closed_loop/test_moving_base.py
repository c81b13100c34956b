"""A base that turns under a target that stands still, with simulated servos and a camera."""

import math

import numpy as np
import pytest
from closed_loop import SimulatedHead

from head_tracking.tracking import (
    LAWS,
    HeadBase,
    Target,
    TargetPlacer,
    TargetState,
    Tracker,
)
from head_tracking.transforms import Rotation, Transform, TransformBuffer

START = 1_000.0  # s
PERIOD = 0.02  # s
SEEN = 0.0045  # s from the start of a cycle until the camera takes its picture
SEEN_LATE = 0.06  # s
ODOMETRY_LATE = 0.02  # s
WORLD = (3.0, 0.5, 0.6)  # m, in odom


def turn(time):
    """At 1 rad/s, from one side to the other."""
    return min(max(time - 2.0, -1.9), 1.9)


def sway(time):
    """To and fro, at up to 1 rad/s."""
    return math.sin(time)


def stop_and_go(time):
    """It turns by 0.6 rad at up to 1 rad/s, stands for a while, and goes on."""
    turns, since = divmod(time, 1.2)
    if since < 0.25:
        way = 2.0 * since * since
    elif since < 0.6:
        way = 0.125 + since - 0.25
    else:
        way = 0.6 - 2.0 * max(0.85 - since, 0.0) ** 2
    return 0.6 * turns + way - 0.9


def stand(time):
    return 0.3


def base_pose(time, yaw):
    """It drives a circle's arc while it turns."""
    angle = yaw(time)
    return Transform((0.3 * math.sin(angle), 0.1 * angle, 0.0), Rotation.from_rpy(0, 0, angle))


def ns(time):
    return round(time * 1e9)


def errors(model, head, yaw, fixed_frame):
    """By how much the head really misses while the base turns [rad], rms."""
    buffer, servos = TransformBuffer(), SimulatedHead()
    buffer.set_model(model)
    base = HeadBase(buffer, "odom", head.base_frame) if fixed_frame == "odom" else None
    tracker = Tracker(
        head,
        LAWS["predictive"](head, PERIOD),
        base=base,
    )
    placer = TargetPlacer(buffer, fixed_frame, 1.0)
    mount = model.transform("base_link", head.base_frame, {})
    odometry, camera, misses = [], [], []
    for k in range(round(3.6 / PERIOD)):
        now = k * PERIOD
        stamp, end, positions = servos.read(ns(now))
        step_at = end * 1e-9
        odometry.append((now + ODOMETRY_LATE, now))
        if k % 2 == 0:
            seen = now + SEEN
            pan, tilt = servos.true_positions(ns(seen))
            T_base_camera = model.transform(
                "base_link", "camera_link", {head.pan_joint: pan, head.tilt_joint: tilt}
            )
            point = (base_pose(seen, yaw) @ T_base_camera).inverse() @ WORLD
            camera.append((seen + SEEN_LATE, Target(ns(START + seen), "camera_link", point)))
        buffer.set_joint_positions(
            ns(START) + stamp, dict(zip((head.pan_joint, head.tilt_joint), positions, strict=True))
        )
        while odometry and odometry[0][0] <= step_at:
            _, at = odometry.pop(0)
            buffer.set_transform(ns(START + at), "odom", "base_link", base_pose(at, yaw))
        tracker.joints_read(START + stamp * 1e-9, positions)
        while camera and camera[0][0] <= step_at:
            placer.offer(camera.pop(0)[1], START + step_at)
        for target, point in placer.place(START + step_at, {}):
            tracker.target_seen(target.stamp * 1e-9, point, START + step_at)
        command = tracker.step(START + step_at).command
        if command is not None:
            servos.write(command, end + 1_000_000)
        for part in range(4):
            time = step_at + part * 0.0025
            T_odom_head = base_pose(time, yaw) @ mount
            point = T_odom_head.inverse() @ WORLD
            if time > 1.2:
                misses.append(head.miss(point, *servos.true_positions(ns(time))))
    assert tracker.state is TargetState.TRACKING
    return float(np.sqrt(np.mean(np.array(misses) ** 2)))


@pytest.mark.parametrize(("yaw", "most"), [(turn, 0.005), (sway, 0.006), (stop_and_go, 0.03)])
def test_a_turning_base_costs_little_where_the_fixed_frame_stands_still(kinectbot, head, yaw, most):
    fixed = errors(kinectbot, head, yaw, "odom")
    print(f"{yaw.__name__}: {1e3 * fixed:.1f} mrad rms")
    assert fixed < most


def test_a_fixed_frame_is_better_than_one_that_turns_by_fits_and_starts(kinectbot, head):
    fixed, carried = (
        errors(kinectbot, head, stop_and_go, frame) for frame in ("odom", head.base_frame)
    )
    assert fixed < 0.65 * carried


def test_a_base_that_stands_still_costs_nothing(kinectbot, head):
    fixed, carried = (errors(kinectbot, head, stand, frame) for frame in ("odom", head.base_frame))
    assert fixed == pytest.approx(carried, abs=1e-3)
