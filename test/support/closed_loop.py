"""A head, its servos, a camera on it or beside it, and a target: one run, in simulated time.

What benchmarks and closed-loop tests drive. Points go through the transforms and the placing that
a node uses, whether the camera moves with the head or not.
"""

from __future__ import annotations

import functools
import heapq
import math
import random
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol, TypeAlias

from dynamixel_fakes import speed_ticks

from head_tracking.dynamixel import JointConfiguration
from head_tracking.dynamixel.protocol import read_packet, sync_write_packet
from head_tracking.gaze import HeadCommand, PanTiltHead
from head_tracking.share import robot_file
from head_tracking.simulation import SimulatedBus, SimulatedServo
from head_tracking.simulation.packets import decode_status
from head_tracking.tracking import Sample, Target, TargetPlacer, Trace, TrackingStep
from head_tracking.transforms import RobotModel, TransformBuffer, Vector3, load_robot_model

Path = Callable[[float], Vector3]
"""Where a target is [m], in the head's base frame, at a time [s]."""

_START = 1_000.0  # s
_SAMPLES = 250.0  # of the truth, a second
_CYCLES = 50.0  # of the bus, a second
_UPDATE = 1_000_000  # ns from a reading to the packet that answers it
_SEEN = 0.0063  # s by which points come after cycles: at 30 a second they wait 10 ms on average


class Controller(Protocol):
    """What turns a head; `Tracker` is one."""

    def joints_read(self, stamp: float, positions: tuple[float, float]) -> None:
        """Takes pan and tilt [rad] as measured at `stamp` [s]."""

    def target_seen(
        self, stamp: float, point: Vector3, now: float, *, moving: bool = False
    ) -> object:
        """Takes a point [m] that was seen at `stamp` [s], perhaps by a camera on the head."""

    def step(self, now: float) -> TrackingStep:
        """What to do now."""


class JointsRead(NamedTuple):
    """What came of a reading.

    Attributes:
        stamp: the middle of it [ns].
        end: when it was complete [ns].
        positions: of pan and tilt [rad].
    """

    stamp: int
    end: int
    positions: tuple[float, float]


class Servos(Protocol):
    """Pan and tilt; times in ns."""

    @property
    def goals(self) -> tuple[int, int] | None:
        """What was written last, in steps of the servos."""

    def read(self, now: int) -> JointsRead:
        """Asks both servos where they are."""

    def write(self, command: HeadCommand, now: int) -> None:
        """Sends both servos their goals."""

    def true_positions(self, now: int) -> tuple[float, float]:
        """Where pan and tilt really are [rad]."""


@functools.cache
def kinectbot() -> RobotModel:
    """The robot on which runs are made."""
    return load_robot_model(robot_file("kinectbot"))


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
        block = PAN.model.goal
        ticks = PAN.ticks(command.pan), TILT.ticks(command.tilt)
        speeds = speed_ticks(PAN, command.pan_speed), speed_ticks(TILT, command.tilt_speed)
        shares: Mapping[int, bytes] = {
            joint.id: block.encode(tick, speed)
            for joint, tick, speed in zip(self._joints, ticks, speeds, strict=True)
        }
        packet = sync_write_packet(1, block.address, shares)
        self._bus.receive(packet, now + _ADAPTER + len(packet) * _BYTE)
        self.goals = ticks


Make: TypeAlias = Callable[[tuple[float, float]], Servos]


def ax12(modify: Callable[[SimulatedServo], object] = lambda servo: None) -> Make:
    """Simulated AX-12 servos, down to the bytes on the wire."""
    return lambda start: SimulatedHead(start, modify)


class Mounted:
    """Servos that turn the head otherwise than their angles say; they themselves notice nothing.

    Args:
        servos: as they would be.
        turns: how far pan and tilt of the head turn for each radian of the pan servo, and of the
            tilt servo: ((1, 0), (0, 1)) if they are mounted as they should be.
    """

    def __init__(self, servos: Servos, turns: tuple[tuple[float, float], ...]) -> None:
        self._servos, self._turns = servos, turns
        self.read, self.write = servos.read, servos.write

    @property
    def goals(self) -> tuple[int, int] | None:
        """See `Servos`."""
        return self._servos.goals

    def true_positions(self, now: int) -> tuple[float, float]:
        """See `Servos`."""
        by_pan, by_tilt = self._turns
        pan, tilt = self._servos.true_positions(now)
        return by_pan[0] * pan + by_tilt[0] * tilt, by_pan[1] * pan + by_tilt[1] * tilt


@dataclass(frozen=True)
class PlainServo:
    """A servo of no make, by its equations: what the law's own model knows nothing of.

    Attributes:
        dead_time: from a command to the start of the motion [s].
        lag: of the position loop [s].
        speed: highest [rad/s].
        acceleration: highest [rad/s^2].
        dead_band: errors below this are not driven [rad].
        play: between gear and camera, to either side [rad].
        resolution: of the encoder [rad].
    """

    dead_time: float = 0.01
    lag: float = 0.025
    speed: float = 6.0
    acceleration: float = 100.0
    dead_band: float = 0.002
    play: float = 0.0
    resolution: float = 0.0015

    def __call__(self, start: tuple[float, float]) -> Servos:
        """Both joints of a head."""
        return _PlainHead(self, start)


class _PlainHead:
    def __init__(self, servo: PlainServo, start: tuple[float, float]) -> None:
        self.goals: tuple[int, int] | None = None
        self._joints = tuple(_PlainJoint(servo, position) for position in start)

    def read(self, now: int) -> JointsRead:
        stamp = now + 1_000_000
        step = self._joints[0].servo.resolution
        pan, tilt = (step * round(position / step) for position in self.true_positions(stamp))
        return JointsRead(stamp, now + 2_000_000, (pan, tilt))

    def write(self, command: HeadCommand, now: int) -> None:
        written, step = now * 1e-9, self._joints[0].servo.resolution
        self._joints[0].commands.append((written, command.pan, command.pan_speed))
        self._joints[1].commands.append((written, command.tilt, command.tilt_speed))
        self.goals = round(command.pan / step), round(command.tilt / step)

    def true_positions(self, now: int) -> tuple[float, float]:
        pan, tilt = (joint.advance(now) for joint in self._joints)
        return pan, tilt


class _PlainJoint:
    def __init__(self, servo: PlainServo, position: float) -> None:
        self.servo = servo
        self.commands: deque[tuple[float, float, float]] = deque()
        self._position = self._setpoint = self._goal = self._camera = position
        self._velocity = self._speed = 0.0
        self._milliseconds = 0

    def advance(self, now: int) -> float:
        s, dt = self.servo, 0.001
        while self._milliseconds * 1_000_000 < now:
            self._milliseconds += 1
            time = self._milliseconds * dt
            while self.commands and self.commands[0][0] + s.dead_time <= time:
                _, self._goal, self._speed = self.commands.popleft()
            way = self._goal - self._setpoint
            self._setpoint += min(max(way, -self._speed * dt), self._speed * dt)
            off = self._setpoint - self._position
            off = 0.0 if abs(off) < s.dead_band else off - math.copysign(s.dead_band, off)
            wanted = min(max(off / s.lag, -s.speed), s.speed)
            change = min(max((wanted - self._velocity) / 0.008, -s.acceleration), s.acceleration)
            self._velocity += change * dt
            self._position += self._velocity * dt
            self._camera = min(max(self._camera, self._position - s.play), self._position + s.play)
        return self._camera


@dataclass(frozen=True, slots=True)
class Conditions:
    """What a run is like.

    Attributes:
        duration: [s].
        rate: commands a second.
        points: of the target, a second.
        delay: age of a point when it comes [s].
        noise: standard deviation of its bearing, in both directions [rad].
        range_noise: standard deviation of its distance, as a share of it.
        depth_noise: standard deviation of its distance [m].
        camera: whether the camera moves with the head; else points come in the base frame.
        stamp_error: what stamps are off by [s]; above 0: they are too late.
        stamp_jitter: standard deviation of that [s].
        jitter: standard deviation of the times between points, as a share of them.
        lost: the share of the points that never come.
        gap: from when to when [s] none comes.
        outliers: the share of the points that are elsewhere.
        outlier: how far away they are at most, in both directions [rad].
        start: pan and tilt at first [rad].
        seed: of all that is random.
        servos: both joints.
        spoil: what becomes of a point (time, place) on its way; None: it is lost.
    """

    duration: float
    rate: float = 50.0
    points: float = 30.0
    delay: float = 0.0
    noise: float = 0.0
    range_noise: float = 0.0
    depth_noise: float = 0.0
    camera: bool = False
    stamp_error: float = 0.0
    stamp_jitter: float = 0.0
    jitter: float = 0.0
    lost: float = 0.0
    gap: tuple[float, float] = (0.0, 0.0)
    outliers: float = 0.0
    outlier: float = 0.15
    start: tuple[float, float] = (0.0, 0.0)
    seed: int = 1
    servos: Make = field(default_factory=ax12)
    spoil: Callable[[float, Vector3], Vector3 | None] = lambda time, point: point


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a run.

    Attributes:
        recording: of the true angles.
        commands: time [s] and command.
        goals: what was written, cycle by cycle, in steps of the servo.
        costs: of each step [s].
        point_costs: of taking each point [s].
    """

    recording: Trace
    commands: list[tuple[float, HeadCommand]] = field(default_factory=list)
    goals: list[tuple[int, int]] = field(default_factory=list)
    costs: list[float] = field(default_factory=list)
    point_costs: list[float] = field(default_factory=list)


class _Event(NamedTuple):
    time: float
    order: int
    kind: str
    at: float = 0.0


class ClosedLoop:
    """Runs a controller against servos.

    Args:
        head: the head that is turned, the kinectbot's.
        path: of the target.
        conditions: of the run.
    """

    def __init__(self, head: PanTiltHead, path: Path, conditions: Conditions) -> None:
        model = kinectbot()
        self._head = head
        self._path = path
        self._conditions = conditions
        self._servos = conditions.servos(conditions.start)
        self._random = random.Random(conditions.seed)
        self._buffer = TransformBuffer()
        self._buffer.set_model(model)
        self._placer = TargetPlacer(self._buffer, head.base_frame, 1.0)
        self._camera = model.chain(head.base_frame, head.pointing_frame)

    def run(self, controller: Controller) -> Outcome:
        """One run from the start to the end: in each cycle read, update, write."""
        outcome = Outcome(Trace())
        seen: deque[tuple[float, Target]] = deque()
        stepped = -math.inf
        for event in self._events():
            now = event.time
            if event.kind == "seen":
                target = self._seen(now)
                if target is not None:
                    seen.append((now + self._conditions.delay, target))
            elif event.kind == "truth":
                self._judge(now, outcome.recording)
            else:
                read = self._servos.read(_ns(now))
                stamp = _START + read.stamp * 1e-9
                self._hear(stamp, read.positions)
                controller.joints_read(stamp, read.positions)
                if now - stepped > 0.99 / self._conditions.rate:
                    stepped = now
                    command = self._update(controller, read.end * 1e-9, seen, outcome)
                    if command is not None:
                        self._servos.write(command, read.end + _UPDATE)
                if self._servos.goals is not None:
                    outcome.goals.append(self._servos.goals)
        return outcome

    def _update(
        self,
        controller: Controller,
        now: float,
        seen: deque[tuple[float, Target]],
        outcome: Outcome,
    ) -> HeadCommand | None:
        before = time.perf_counter()
        while seen and seen[0][0] <= now:
            self._placer.offer(seen.popleft()[1], _START + now)
        for placed, point in self._placer.place(_START + now, {}):
            controller.target_seen(
                placed.stamp * 1e-9, point, _START + now, moving=self._conditions.camera
            )
            outcome.point_costs.append(time.perf_counter() - before)
            before = time.perf_counter()
        before = time.perf_counter()
        command = controller.step(_START + now).command
        outcome.costs.append(time.perf_counter() - before)
        if command is not None:
            outcome.commands.append((now, command))
        return command

    def _events(self) -> list[_Event]:
        """Everything that happens, in order."""
        c = self._conditions

        def every(rate: float, first: float, order: int, kind: str) -> Iterator[_Event]:
            return (_Event(k / rate + first, order, kind) for k in range(int(c.duration * rate)))

        captures = sorted(
            max(0.0, (k + self._random.gauss(0.0, c.jitter)) / c.points) + _SEEN
            for k in range(int(c.duration * c.points))
            if self._random.random() >= c.lost
        )
        return list(
            heapq.merge(
                every(max(_CYCLES, c.rate), 0.0, 0, "cycle"),
                (_Event(at, 1, "seen") for at in captures if not c.gap[0] <= at < c.gap[1]),
                every(_SAMPLES, 0.0039, 2, "truth"),
            )
        )

    def _hear(self, stamp: float, positions: tuple[float, float]) -> None:
        head = self._head
        joints = dict(zip((head.pan_joint, head.tilt_joint), positions, strict=True))
        self._buffer.set_joint_positions(_ns(stamp), joints)

    def _seen(self, at: float) -> Target | None:
        c, rng = self._conditions, self._random
        point: Vector3 | None = self._path(at)
        aside, upwards = rng.gauss(0.0, c.noise), rng.gauss(0.0, c.noise)
        away = rng.gauss(0.0, c.range_noise)
        deeper, late = rng.gauss(0.0, c.depth_noise), rng.gauss(0.0, c.stamp_jitter)
        if rng.random() < c.outliers:
            aside += rng.uniform(-c.outlier, c.outlier)
            upwards += rng.uniform(-c.outlier, c.outlier)
        assert point is not None
        frame = self._head.base_frame
        if c.camera:
            positions = self._servos.true_positions(_ns(at))
            known = dict(zip((self._head.pan_joint, self._head.tilt_joint), positions, strict=True))
            camera = self._camera.transform(*(known[name] for name in self._camera.joints))
            point, frame = camera.inverse() @ point, self._head.pointing_frame
        if c.noise or c.outliers:
            point = turned(point, aside, upwards)
        distance = math.hypot(*point)
        scale = max(0.05, math.exp(away) + deeper / distance)
        point = c.spoil(at, (point[0] * scale, point[1] * scale, point[2] * scale))
        if point is None:
            return None
        return Target(_ns(_START + at + c.stamp_error + late), frame, point)

    def _judge(self, now: float, recording: Trace) -> None:
        pan, tilt = self._servos.true_positions(_ns(now))
        point = self._path(now)
        gaze = self._head.gaze(point, pan, tilt)
        miss = self._head.miss(point, pan, tilt)
        recording.add(Sample(now, (gaze.pan, gaze.tilt), (pan, tilt), miss))


def turned(point: Vector3, aside: float, upwards: float) -> Vector3:
    """A point at the same distance, but seen a little [rad] aside and higher."""
    x, y, z = point
    flat, distance = max(math.hypot(x, y), 1e-9), math.hypot(x, y, z)
    a, u = aside * distance, upwards * distance
    return (
        x - a * y / flat - u * x * z / (flat * distance),
        y + a * x / flat - u * y * z / (flat * distance),
        z + u * flat / distance,
    )


def _ns(time: float) -> int:
    return round(time * 1e9)
