"""A head, its servos, cameras on it or beside it, and a target: one run, in simulated time.

Benchmarks and closed-loop tests drive it. What a camera sees and by how much a head misses is
computed by `plant`, without the package; points go to the tracker through the package's transforms.
"""

from __future__ import annotations

import functools
import heapq
import math
import random
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from dynamixel_fakes import speed_ticks
from plant import JointsRead, Make, angles, in_camera, turned

from head_tracking.dynamixel import JointConfiguration, servo_model
from head_tracking.dynamixel.protocol import read_packet, sync_write_packet
from head_tracking.gaze import HeadCommand
from head_tracking.share import robot_file
from head_tracking.simulation import SimulatedBus, SimulatedServo
from head_tracking.simulation.packets import decode_status
from head_tracking.tracking import Sample, Target, TargetPlacer, Trace
from head_tracking.transforms import (
    RobotModel,
    Rotation,
    Transform,
    TransformBuffer,
    Vector3,
    load_robot_model,
)

Path = Callable[[float], Vector3]
"""Where a target is [m], in the head's base frame, at a time [s]."""

START = 1_000.0
"""What the package's clock shows when a run starts [s]."""

BASE_FRAME, CAMERA_FRAME = "head_pan_link", "camera_link"
_SAMPLES = 250.0  # of the truth, a second
_CYCLES = 50.0  # of the bus, a second
_UPDATE = 1_000_000  # ns from a reading to the packet that answers it
_SEEN = 0.0063  # s by which points come after cycles: at 30 a second they wait 10 ms on average
_ODOMETRY_LATE = 0.02  # s


@functools.cache
def kinectbot() -> RobotModel:
    """The robot on which runs are made."""
    return load_robot_model(robot_file("kinectbot"))


_BYTE = 10_000  # ns at 1 Mbit/s
_ADAPTER = 100_000  # ns for a packet to get onto the wire
_ANSWERED = 300_000  # ns for an answer to get off it

PAN = JointConfiguration("head_pan_joint", 1, controller="head_pan_controller")
TILT = JointConfiguration("head_tilt_joint", 2, controller="head_tilt_controller")


class SimulatedHead:
    """Pan and tilt on AX-12 servos. Time is passed in, as integer ns."""

    def __init__(
        self,
        start: tuple[float, float] = (0.0, 0.0),  # pan and tilt at first [rad]
        # is handed both servos, to make them others than an AX-12 usually is
        modify: Callable[[SimulatedServo], object] = lambda servo: None,
        joints: tuple[JointConfiguration, JointConfiguration] = (PAN, TILT),
    ) -> None:
        self._joints = joints
        self._servos = tuple(
            SimulatedServo(joint.id, joint.model, position=joint.ticks(position))
            for joint, position in zip(self._joints, start, strict=True)
        )
        for servo in self._servos:
            modify(servo)
        self._bus = SimulatedBus(self._servos)
        self.goals: tuple[int, int] | None = None

    def read(self, now: int) -> JointsRead:
        """Asks both servos where they are, one after the other."""
        time, stamps, positions = now, [], []
        for joint in self._joints:
            register = joint.model.control_table["Present Position"]
            sent = read_packet(1, joint.id, register.address, register.size)
            asked = time
            time += _ADAPTER + len(sent) * _BYTE
            (answer,) = self._bus.receive(sent, time)
            time += answer.delay + len(answer.data) * _BYTE + _ANSWERED
            status = decode_status(1, answer.data)
            assert status is not None
            stamps.append((asked + time) // 2)
            positions.append(joint.position(int.from_bytes(status.data, "little")))
        return JointsRead(sum(stamps) // 2, time, (positions[0], positions[1]))

    def true_positions(self, now: int) -> tuple[float, float]:
        """Where pan and tilt really are [rad]."""
        self._bus.advance(now)
        pan, tilt = (
            joint.position(servo.true_ticks)
            for joint, servo in zip(self._joints, self._servos, strict=True)
        )
        return pan, tilt

    def write(self, command: HeadCommand, now: int) -> None:
        """Sends both servos their goals, in one packet."""
        pan, tilt = self._joints
        block = pan.model.goal
        ticks = pan.ticks(command.pan), tilt.ticks(command.tilt)
        speeds = speed_ticks(pan, command.pan_speed), speed_ticks(tilt, command.tilt_speed)
        shares: Mapping[int, bytes] = {
            joint.id: block.encode(tick, speed)
            for joint, tick, speed in zip(self._joints, ticks, speeds, strict=True)
        }
        packet = sync_write_packet(1, block.address, shares)
        self._bus.receive(packet, now + _ADAPTER + len(packet) * _BYTE)
        self.goals = ticks


def ax12(modify: Callable[[SimulatedServo], object] = lambda servo: None) -> Make:
    """Simulated AX-12 servos, down to the bytes on the wire."""
    return lambda start: SimulatedHead(start, modify)


def mx28(modify: Callable[[SimulatedServo], object]) -> Make:
    """The same with MX-28 servos, which have finer encoders."""
    fine = {"model": servo_model("MX-28"), "init": 2048, "max": 4095}
    joints = replace(PAN, **fine), replace(TILT, **fine)
    return lambda start: SimulatedHead(start, modify, joints)


class Mounted:
    """Servos that turn the head otherwise than their angles say; they themselves notice nothing.

    Args:
        servos: as they would be.
        turns: how far pan and tilt of the head turn for each radian of the pan servo, and of the
            tilt servo: ((1, 0), (0, 1)) if they are mounted as they should be.
    """

    def __init__(self, servos: Any, turns: tuple[tuple[float, float], ...]) -> None:
        self._servos, self._turns = servos, turns

    def __getattr__(self, name: str) -> Any:
        return getattr(self._servos, name)

    def true_positions(self, now: int) -> tuple[float, float]:
        by_pan, by_tilt = self._turns
        pan, tilt = self._servos.true_positions(now)
        return by_pan[0] * pan + by_tilt[0] * tilt, by_pan[1] * pan + by_tilt[1] * tilt


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera and the way of its points to the tracker."""

    points: float = 30.0  # of the target, a second
    delay: float = 0.0  # mean age of a point when it arrives [s]
    delay_jitter: float = 0.0  # standard deviation of that [s]; points may overtake each other
    batch: float = 0.0  # points wait and arrive together, at multiples of this time [s]; 0: at once
    noise: float = 0.0  # standard deviation of the bearing, in both directions [rad]
    range_noise: float = 0.0  # standard deviation of the distance, as a ratio
    depth_noise: float = 0.0  # standard deviation of the distance [m]
    # the camera moves with the head; else points come in the head's base frame
    on_head: bool = False
    # width and height of what a camera on the head sees [rad]
    field: tuple[float, float] = (math.radians(60.0), math.radians(45.0))
    # how far the camera is really turned to the left and up from the model [rad]
    extrinsic: tuple[float, float] = (0.0, 0.0)
    stamp_error: float = 0.0  # what stamps are off by [s]; above 0: they are too late
    stamp_jitter: float = 0.0  # standard deviation of that [s]
    jitter: float = 0.0  # standard deviation of the times between points, as a ratio
    lost: float = 0.0  # the probability that a point never comes
    outage: float = 0.0  # mean time that lost points are lost in a row [s]; 0: one by one
    gaps: tuple[tuple[float, float], ...] = ()  # from when to when [s] none comes
    outliers: float = 0.0  # the probability that a point is elsewhere
    outlier: float = 0.15  # how far away these are at most, in both directions [rad]

    def captures(self, duration: float, rng: random.Random) -> list[float]:
        """Draw the times at which points are seen [s]."""
        times, is_lost = [], False
        for k in range(int(duration * self.points)):
            time = max(0.0, (k + rng.gauss(0.0, self.jitter)) / self.points) + _SEEN
            if self.outage > 0.0:
                leave = 1.0 / (self.outage * self.points)
                enter = leave * self.lost / max(1.0 - self.lost, 1e-9)
                is_lost = rng.random() >= leave if is_lost else rng.random() < enter
            else:
                is_lost = rng.random() < self.lost
            if not is_lost and not any(a <= time < b for a, b in self.gaps):
                times.append(time)
        return sorted(times)

    def arrival(self, time: float, rng: random.Random) -> float:
        """Draw when a point that was seen at a time [s] arrives."""
        arrives = time + max(self.delay + rng.gauss(0.0, self.delay_jitter), 0.1 * self.delay)
        return arrives if self.batch == 0.0 else math.ceil(arrives / self.batch) * self.batch


@dataclass(frozen=True, slots=True)
class Conditions(Camera):
    """What a run is like; the attributes of `Camera` are those of its first camera."""

    duration: float = 10.0  # [s]
    rate: float = 50.0  # commands a second
    late: float = 0.0  # the probability that a cycle is late
    lateness: tuple[float, float] = (0.06, 0.15)  # how late such a cycle is, from and to [s]
    start: tuple[float, float] = (0.0, 0.0)  # pan and tilt at first [rad]
    # position x, y [m] and yaw [rad] of the robot at a time [s]; paths are given in the head's base
    # frame as it is where these are 0. None: it never moves.
    base: Callable[[float], tuple[float, float, float]] | None = None
    fixed_frame: str = "odom"  # the frame in which the package keeps targets, if there is a base
    more: tuple[Camera, ...] = ()  # further cameras
    seed: int = 1  # of all that is random
    servos: Make = field(default_factory=ax12)  # both joints


WEBCAM = Conditions(
    points=15.0,
    delay=0.12,
    delay_jitter=0.03,
    noise=0.005,
    outliers=0.05,
    outlier=0.3,
    lost=0.03,
    on_head=True,
)
"""A webcam and a neural detector on a small computer."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of a run."""

    recording: Trace  # of the true angles
    commands: list[tuple[float, HeadCommand]] = field(default_factory=list)  # time [s] and command
    # what was written, cycle by cycle, in steps of the servo
    goals: list[tuple[int, int]] = field(default_factory=list)
    costs: list[float] = field(default_factory=list)  # of each step [s]
    point_costs: list[float] = field(default_factory=list)  # of each point [s]
    seen: list[float] = field(default_factory=list)  # times [s] of the points that any camera saw


class ClosedLoop:
    """Runs a controller against servos and cameras, in simulated time.

    One with the methods of `Tracker` is given points as a node gives them, transformed by the
    package. One that shares nothing with the package has instead, with times that begin at 0:
    `joints_read(stamp, positions)`; `base_moved(now, (x, y, yaw))`; `command(now)`; and
    `camera_saw(stamp, point, now, on_head=)` with what a camera measured, in its own or the head's
    base frame.
    """

    def __init__(
        self,
        path: Path,  # of the target
        conditions: Conditions,  # of the run
        # called after each step with the time [s]
        observe: Callable[[float], None] = lambda now: None,
    ) -> None:
        c = conditions
        self._path, self._conditions, self._observe = path, c, observe
        self._servos = c.servos(c.start)
        self._random = random.Random(c.seed)
        self._cameras: tuple[Camera, ...] = (c, *c.more)
        self._is_raw = False
        self._inbox: list[tuple[float, int, Target, bool]] = []
        self.buffer = TransformBuffer()  # the robot's transforms as the package knows them
        self.buffer.set_model(kinectbot())
        fixed = BASE_FRAME if c.base is None else c.fixed_frame
        self._placer = TargetPlacer(self.buffer, fixed, 1.0)

    def truth(self, time: float) -> Vector3:
        """Return where the target is in the head's base frame [m]."""
        point = self._path(time)
        if self._conditions.base is None:
            return point
        x, y, yaw = self._conditions.base(time)
        c, s = math.cos(yaw), math.sin(yaw)
        dx, dy = point[0] - x, point[1] - y
        return c * dx + s * dy, c * dy - s * dx, point[2]

    def run(self, controller: Any) -> Outcome:
        """Run from the start to the end: in each cycle read, update, write."""
        outcome, self._is_raw = Outcome(Trace()), hasattr(controller, "camera_saw")
        stepped = -math.inf
        for event in self._events():
            now = event.time
            if event.camera is not None:
                self._capture(now, event.camera, outcome)
            elif not event.is_cycle:
                self._judge(now, outcome.recording)
            else:
                read = self._servos.read(_ns(now))
                self._hear(read.stamp, read.positions, controller)
                if now - stepped > 0.99 / self._conditions.rate:
                    stepped = now
                    command = self._update(controller, read.end * 1e-9, outcome)
                    if command is not None:
                        self._servos.write(command, read.end + _UPDATE)
                    self._observe(read.end * 1e-9)
                if self._servos.goals is not None:
                    outcome.goals.append(self._servos.goals)
        return outcome

    def _update(self, controller: Any, now: float, outcome: Outcome) -> HeadCommand | None:
        arrived = []
        while self._inbox and self._inbox[0][0] <= now:
            arrived.append(heapq.heappop(self._inbox))
        before = time.perf_counter()
        if self._is_raw:
            for _, _, target, on_head in arrived:
                stamp = target.stamp * 1e-9 - START
                controller.camera_saw(stamp, target.point, now, on_head=on_head)
            command = controller.command(now)
        else:
            for _, _, target, _ in arrived:
                self._placer.offer(target, START + now)
            for placed, point in self._placer.place(START + now, {}):
                moving = placed.frame_id != BASE_FRAME
                controller.target_seen(placed.stamp * 1e-9, point, START + now, moving=moving)
                outcome.point_costs.append(time.perf_counter() - before)
                before = time.perf_counter()
            before = time.perf_counter()
            command = controller.step(START + now).command
        outcome.costs.append(time.perf_counter() - before)
        if command is not None:
            outcome.commands.append((now, command))
        return command

    def _events(self) -> list[_Event]:
        """Return everything that happens, in order."""
        c, rng = self._conditions, self._random
        streams = [
            [_Event(at, 1, camera=index) for at in camera.captures(c.duration, rng)]
            for index, camera in enumerate(self._cameras)
        ]
        cycles, now = [], 0.0
        while now < c.duration:
            is_late = rng.random() < c.late
            cycles.append(_Event(now + (rng.uniform(*c.lateness) if is_late else 0.0), 0, True))
            period = 1.0 / max(_CYCLES, c.rate)
            now = period * math.ceil(cycles[-1].time / period + 0.5)
        truth = [_Event(k / _SAMPLES + 0.0039, 2) for k in range(int(c.duration * _SAMPLES))]
        return list(heapq.merge(cycles, truth, *streams))

    def _hear(
        self,
        stamp: int,
        positions: tuple[float, float],
        controller: Any,
    ) -> None:
        base, at = self._conditions.base, stamp * 1e-9
        pose = (0.0, 0.0, 0.0) if base is None else base(at - _ODOMETRY_LATE)
        if self._is_raw:
            controller.joints_read(at, positions)
            controller.base_moved(at, pose)
            return
        self.buffer.set_joint_positions(
            _ns(START) + stamp, dict(zip((PAN.joint_name, TILT.joint_name), positions, strict=True))
        )
        if base is not None:
            x, y, yaw = pose
            self.buffer.set_transform(
                _ns(START + at - _ODOMETRY_LATE),
                "odom",
                "base_link",
                Transform((x, y, 0.0), Rotation.from_rpy(0.0, 0.0, yaw)),
            )
        controller.joints_read(START + at, positions)

    def _capture(self, at: float, index: int, outcome: Outcome) -> None:
        camera, rng = self._cameras[index], self._random
        point, frame = self.truth(at), BASE_FRAME
        left, up = rng.gauss(0.0, camera.noise), rng.gauss(0.0, camera.noise)
        away, deeper = rng.gauss(0.0, camera.range_noise), rng.gauss(0.0, camera.depth_noise)
        late, arrives = rng.gauss(0.0, camera.stamp_jitter), camera.arrival(at, rng)
        is_outlier = rng.random() < camera.outliers
        wild = [rng.uniform(-camera.outlier, camera.outlier) for _ in range(2)]
        if camera.on_head:
            point, frame = in_camera(point, *self._servos.true_positions(_ns(at))), CAMERA_FRAME
            point = turned(point, -camera.extrinsic[0], -camera.extrinsic[1])
            x, y, z = point
            width, height = camera.field
            if abs(math.atan2(y, x)) > 0.5 * width or abs(math.atan2(z, x)) > 0.5 * height:
                return
        outcome.seen.append(at)
        point = turned(point, left + is_outlier * wild[0], up + is_outlier * wild[1])
        scale = max(0.05, math.exp(away) + deeper / math.hypot(*point))
        seen = point[0] * scale, point[1] * scale, point[2] * scale
        target = Target(_ns(START + at + camera.stamp_error + late), frame, seen)
        heapq.heappush(self._inbox, (arrives, len(outcome.seen), target, camera.on_head))

    def _judge(self, now: float, recording: Trace) -> None:
        positions, point = self._servos.true_positions(_ns(now)), self.truth(now)
        x, y, z = in_camera(point, *positions)
        left, up = self._conditions.extrinsic
        if left or up:
            x, y, z = turned((x, y, z), -left, -up)
        miss = math.atan2(math.hypot(y, z), x)
        recording.add(Sample(now, angles(point), positions, miss))


class _Event(NamedTuple):
    time: float
    order: int
    is_cycle: bool = False
    camera: int | None = None


def _ns(time: float) -> int:
    return round(time * 1e9)
