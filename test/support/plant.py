"""An independent pan-tilt head: its geometry in closed form and its servos by their equations.

Nothing here is shared with the package's gaze, simulation or tracking, so that a mistake there
does not hide here. Angles in rad, lengths in m, times in s unless a name says ns.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from random import Random
from typing import Any, NamedTuple, TypeAlias

from head_tracking.gaze import HeadCommand
from head_tracking.tracking import JointReading

Point: TypeAlias = tuple[float, float, float]
_PAN = (0.0115, 0.0, 0.022)  # m: the kinectbot's pan joint in the head's base frame
_TILT = 0.0395  # m: its tilt axis above that
_CAMERA = (0.09, 0.101)  # m: its camera before and above the tilt axis
PAN_LIMIT = 2.6
_STEP = 0.002  # s of the integration


def in_camera(point: Point, pan: float, tilt: float) -> Point:
    """Return a point of the head's base frame in the camera's: x ahead, y left, z up [m]."""
    x, y, z = point[0] - _PAN[0], point[1] - _PAN[1], point[2] - _PAN[2] - _TILT
    c, s = math.cos(pan), math.sin(pan)
    x, y = c * x + s * y, c * y - s * x
    c, s = math.cos(tilt), math.sin(tilt)
    return c * x - s * z - _CAMERA[0], y, s * x + c * z - _CAMERA[1]


def in_base(point: Point, pan: float, tilt: float) -> Point:
    """Return a point of the camera's frame in the head's base frame [m]."""
    x, y, z = point[0] + _CAMERA[0], point[1], point[2] + _CAMERA[1]
    c, s = math.cos(tilt), math.sin(tilt)
    x, z = c * x + s * z, c * z - s * x
    c, s = math.cos(pan), math.sin(pan)
    return c * x - s * y + _PAN[0], s * x + c * y + _PAN[1], z + _PAN[2] + _TILT


def angles(point: Point) -> tuple[float, float]:
    """Return pan and tilt that look at a point of the head's base frame [rad]."""
    x, y, z = point[0] - _PAN[0], point[1] - _PAN[1], point[2] - _PAN[2] - _TILT
    flat = math.hypot(x, y)
    upwards = math.asin(min(1.0, _CAMERA[1] / math.hypot(flat, z)))
    return math.atan2(y, x), upwards - math.atan2(z, flat)


def turned(point: Point, left: float, up: float) -> Point:
    """Return a point of the camera's frame, turned about its origin to the left and up [rad]."""
    x, y, z = point
    flat = math.hypot(x, y)
    azimuth, elevation, distance = math.atan2(y, x), math.atan2(z, flat), math.hypot(flat, z)
    azimuth, elevation = azimuth + left / max(math.cos(elevation), 0.1), elevation + up
    flat = distance * math.cos(elevation)
    return flat * math.cos(azimuth), flat * math.sin(azimuth), distance * math.sin(elevation)


class JointsRead(NamedTuple):
    """The result of a reading."""

    stamp: int  # the middle of the reading [ns]
    end: int  # when the reading was complete [ns]
    positions: tuple[float, float]  # of pan and tilt [rad]


Make: TypeAlias = Callable[[tuple[float, float]], Any]
"""Makes the servos of pan and tilt, with the methods of `PlainHead`, at start positions [rad]."""


@dataclass(frozen=True, slots=True)
class PlainServo:
    """A servo of no make; called with a start position, it makes both joints of a head."""

    dead_time: float = 0.01  # from a command to the start of the motion [s]
    lag: float = 0.025  # of the position loop [s]
    speed: float = 6.0  # highest [rad/s]
    acceleration: float = 100.0  # highest of the shaft [rad/s^2]; a heavy head has little
    profile: float = math.inf  # acceleration of the set-point [rad/s^2], as in X servos; inf: none
    dead_band: float = 0.002  # errors below this are not driven [rad]
    play: float = 0.0  # between gear and camera, to either side [rad]
    resolution: float = 0.0015  # of the encoder [rad]

    def __call__(self, start: tuple[float, float]) -> PlainHead:
        return PlainHead((self, self), start)

    @staticmethod
    def drawn(rng: Random, dead_time: tuple[float, float], exam: bool = False) -> PlainServo:
        """Draw a servo; an exam's may have a little more of everything."""
        wide = 1.3 if exam else 1.0
        return PlainServo(
            dead_time=rng.uniform(*dead_time),
            lag=rng.uniform(0.01, 0.05 * wide),
            speed=rng.uniform(4.0 / wide, 7.0),
            acceleration=rng.choice((20.0 / wide, 40.0, 100.0)),
            profile=rng.choice((math.inf, math.inf, 40.0 / wide)),
            dead_band=rng.choice((0.0, 0.002, 0.005 * wide)),
            play=rng.choice((0.0, 0.0, 0.004 * wide)),
            resolution=rng.choice((0.0015, 0.005)),
        )


@dataclass(frozen=True, slots=True)
class Pair:
    """Different servos for pan and tilt."""

    pan: PlainServo
    tilt: PlainServo

    def __call__(self, start: tuple[float, float]) -> PlainHead:
        return PlainHead((self.pan, self.tilt), start)


class PlainHead:
    """Pan and tilt by their equations; times in ns."""

    def __init__(self, servos: tuple[PlainServo, PlainServo], start: tuple[float, float]) -> None:
        self.goals: tuple[int, int] | None = None  # the last written ones, in steps of the servos
        self._joints = tuple(map(_Joint, servos, start))

    def read(self, now: int) -> JointsRead:
        """Measure both joints."""
        stamp = now + 1_000_000
        self.true_positions(stamp)
        pan, tilt = (joint.measured for joint in self._joints)
        return JointsRead(stamp, now + 2_000_000, (pan, tilt))

    def write(self, command: HeadCommand, now: int) -> None:
        """Send both joints their goals."""
        (pan, tilt), c = self._joints, command
        for joint, goal, speed in ((pan, c.pan, c.pan_speed), (tilt, c.tilt, c.tilt_speed)):
            joint.commands.append((now * 1e-9 + joint.servo.dead_time, goal, speed))
        self.goals = round(c.pan / pan.servo.resolution), round(c.tilt / tilt.servo.resolution)

    def true_positions(self, now: int) -> tuple[float, float]:
        """Return where the camera really points [rad]."""
        pan, tilt = (joint.advance(now * 1e-9) for joint in self._joints)
        return pan, tilt


class _Joint:
    """One joint: dead time, set-point profile, position loop with lag, play."""

    def __init__(self, servo: PlainServo, position: float) -> None:
        self.servo = servo
        self.commands: deque[tuple[float, float, float]] = deque()
        self._shaft = self._setpoint = self._goal = self._camera = position
        self._velocity = self._setpoint_speed = self._speed = 0.0
        self._steps = 0

    @property
    def measured(self) -> float:
        """The encoder's position [rad]."""
        return self.servo.resolution * round(self._shaft / self.servo.resolution)

    def advance(self, now: float) -> float:
        """Integrate up to a time [s] and return where the camera points [rad]."""
        s, dt, commands = self.servo, _STEP, self.commands
        shaft, setpoint, velocity = self._shaft, self._setpoint, self._velocity
        moved = self._setpoint_speed
        hardest, camera, band, speed = s.acceleration * dt, self._camera, s.dead_band, s.speed
        agility = min(1.0, dt / 0.008)
        while self._steps * dt < now:
            self._steps += 1
            time = self._steps * dt
            while commands and commands[0][0] <= time:
                _, self._goal, self._speed = commands.popleft()
            left = self._goal - setpoint
            fastest = min(self._speed, speed)
            if s.profile == math.inf:
                setpoint += min(max(left, -fastest * dt), fastest * dt)
            else:
                fastest = min(fastest, math.sqrt(2.0 * s.profile * abs(left)))
                change = math.copysign(fastest, left) - moved
                moved += min(max(change, -s.profile * dt), s.profile * dt)
                setpoint += moved * dt
            off = setpoint - shaft
            if off > band:
                wanted = min((off - band) / s.lag, speed)
            elif off < -band:
                wanted = max((off + band) / s.lag, -speed)
            else:
                wanted = 0.0
            velocity += min(max(agility * (wanted - velocity), -hardest), hardest)
            shaft += velocity * dt
            if not -PAN_LIMIT < shaft < PAN_LIMIT:
                shaft, velocity = math.copysign(PAN_LIMIT, shaft), 0.0
            camera = min(max(camera, shaft - s.play), shaft + s.play)
        self._shaft, self._setpoint, self._velocity = shaft, setpoint, velocity
        self._setpoint_speed, self._camera = moved, camera
        return camera


class Deaf:
    """Servos that hear no command for some seconds, as before their torque is on."""

    def __init__(self, servos: Any, seconds: float) -> None:
        self._servos, self._deaf = servos, round(seconds * 1e9)
        self._since: int | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._servos, name)

    def write(self, command: HeadCommand, now: int) -> None:
        self._since = self._since or now
        if now - self._since > self._deaf:
            self._servos.write(command, now)


class PlainStream:
    """Set-points that move at the commanded speeds, a control period apart."""

    def __init__(self) -> None:
        self._setpoint: tuple[float, float] | None = None
        self._last = 0.0

    def positions(
        self, command: HeadCommand | None, joints: JointReading, now: float
    ) -> tuple[float, float] | None:
        """Return the positions to publish now [rad]."""
        dt, self._last = min(now - self._last, 0.1), now
        if command is None:
            return None
        pan, tilt = self._setpoint or joints.positions
        pan_step, tilt_step = command.pan_speed * dt, command.tilt_speed * dt
        pan += min(max(command.pan - pan, -pan_step), pan_step)
        tilt += min(max(command.tilt - tilt, -tilt_step), tilt_step)
        self._setpoint = pan, tilt
        return self._setpoint


@dataclass(frozen=True, slots=True)
class Streamed:
    """A joint trajectory controller at 100 Hz that takes one position after the other, late."""

    dead_time: float  # from a message to its effect [s]
    lag: float = 0.02  # of the joints behind the controller [s]
    stream: Callable[[], Any] = PlainStream  # makes what turns commands into positions

    def __call__(self, start: tuple[float, float]) -> PlainHead:
        servo = PlainServo(self.dead_time, self.lag, dead_band=0.0, resolution=0.0005)
        return _StreamedHead(servo, start, self.stream())


class _StreamedHead(PlainHead):
    def __init__(self, servo: PlainServo, start: tuple[float, float], stream: Any) -> None:
        super().__init__((servo, replace(servo)), start)
        self._stream = stream
        self._measured = JointReading(0.0, start)

    def read(self, now: int) -> JointsRead:
        read = super().read(now)
        self._measured = JointReading(read.stamp * 1e-9, read.positions)
        return read

    def write(self, command: HeadCommand, now: int) -> None:
        positions = self._stream.positions(command, self._measured, now * 1e-9)
        if positions is not None:
            tick = -(-now // 10_000_000) * 10_000_000  # the controller's next cycle [ns]
            super().write(HeadCommand(*positions, 6.0, 6.0), tick)
