"""Simple laws as others write them; they share only the plant's geometry with the judge."""

import math
from collections import deque

from plant import angles as angles_of
from plant import in_base

from head_tracking.gaze import HeadCommand

Point = tuple[float, float, float]
_JUMP, _HELD = 0.1, 0.1  # rad: a point this far off needs another one this near to it
_SILENCE, _RECENTER = 0.5, 10.0  # s without a point: stand; turn to the centre
_LIMITS = (2.6, 1.08)  # rad


class SimpleLaw:
    """What simple laws have in common: joint history, outliers, silence.

    The law itself: go to the latest believed point at 5 rad/s (`position`).
    """

    speed = 5.0

    def __init__(self) -> None:
        self.joints = (0.0, 0.0)
        self.point: Point | None = None
        self.stamp = -math.inf
        self._history: deque[tuple[float, tuple[float, float]]] = deque(maxlen=60)
        self._bases: deque[tuple[float, tuple[float, float, float]]] = deque(maxlen=60)
        self._suspect: Point | None = None

    def joints_read(self, stamp: float, positions: tuple[float, float]) -> None:
        """See `ClosedLoop`."""
        self._history.append((stamp, positions))
        self.joints = positions

    def base_moved(self, now: float, pose: tuple[float, float, float]) -> None:
        """See `ClosedLoop`."""
        self._bases.append((now, pose))

    def camera_saw(self, stamp: float, point: Point, now: float, *, on_head: bool) -> None:
        """See `ClosedLoop`."""
        if on_head:
            point = in_base(point, *self.joints_at(stamp))
        x, y, yaw = min(self._bases, key=lambda entry: abs(entry[0] - stamp))[1]
        c, s = math.cos(yaw), math.sin(yaw)
        point = (c * point[0] - s * point[1] + x, s * point[0] + c * point[1] + y, point[2])
        if stamp <= self.stamp:
            return
        if self.point is not None and stamp - self.stamp < _SILENCE:
            if _apart(point, self.expected(stamp)) > _JUMP and (
                self._suspect is None or _apart(point, self._suspect) > _HELD
            ):
                self._suspect = point
                return
            is_new = self._suspect is not None and _apart(point, self._suspect) <= _HELD
        else:
            is_new = True
        self._suspect = None
        self.accept(stamp, point, is_new)

    def joints_at(self, stamp: float) -> tuple[float, float]:
        """Return pan and tilt as they were at a time [s]."""
        before = None
        for entry in reversed(self._history):
            if entry[0] <= stamp:
                if before is None:
                    return entry[1]
                ratio = (stamp - entry[0]) / (before[0] - entry[0])
                pan, tilt = (a + ratio * (b - a) for a, b in zip(entry[1], before[1], strict=True))
                return pan, tilt
            before = entry
        return self.joints

    def accept(self, stamp: float, point: Point, is_new: bool) -> None:
        """Use a believed point, in the frame that stands still."""
        self.stamp, self.point = stamp, point

    def expected(self, stamp: float) -> Point:
        """Return where the target should be seen at a time [s]."""
        assert self.point is not None
        return self.point

    def here(self, point: Point) -> Point:
        """Return a point in the head's base frame as the robot stands now."""
        x, y, yaw = self._bases[-1][1]
        c, s = math.cos(yaw), math.sin(yaw)
        dx, dy = point[0] - x, point[1] - y
        return c * dx + s * dy, c * dy - s * dx, point[2]

    def command(self, now: float) -> HeadCommand | None:
        """See `ClosedLoop`."""
        if self.point is None:
            return None
        if now - self.stamp > _RECENTER:
            return HeadCommand(0.0, 0.0, 0.3, 0.3)
        return self.steer(now)

    def steer(self, now: float) -> HeadCommand:
        """Return the command for a target that is known."""
        assert self.point is not None
        goal = angles_of(self.here(self.point))
        ways = [abs(a - b) for a, b in zip(goal, self.joints, strict=True)]
        longest = max(*ways, 1e-6)
        pan, tilt = (max(self.speed * way / longest, 0.02) for way in ways)
        return inside(*goal, pan, tilt)


class Tutorials(SimpleLaw):
    """The tutorials' law: speed 1.5/s times the error, at most 2 rad/s, goal 0.5 rad ahead."""

    def steer(self, now: float) -> HeadCommand:
        """See `SimpleLaw`."""
        assert self.point is not None
        errors = [a - b for a, b in zip(angles_of(self.here(self.point)), self.joints, strict=True)]
        goals = [
            at + (math.copysign(0.5, error) if abs(error) > 0.01 else 0.0)
            for at, error in zip(self.joints, errors, strict=True)
        ]
        pan, tilt = (max(min(1.5 * abs(error), 2.0), 0.02) for error in errors)
        return inside(*goals, pan, tilt)


class Kalman(SimpleLaw):
    """A near-constant-velocity Kalman filter of each bearing, with feed-forward.

    White acceleration of 0.3 rad^2/s^3, 4 mrad of noise; the prediction goes to 60 ms after now and
    is held 0.3 s after the last point; speed = |velocity + 10/s * error|.
    """

    _Q, _R, _AHEAD, _LONGEST, _GAIN = 0.3, 0.004**2, 0.06, 0.3, 10.0

    def __init__(self) -> None:
        super().__init__()
        self._states = [(0.0, 0.0), (0.0, 0.0)]
        self._covariance = (self._R, 0.0, 1.0)
        self._distance = 2.0

    def accept(self, stamp: float, point: Point, is_new: bool) -> None:
        """See `SimpleLaw`."""
        measured = angles_of(point)
        self._distance = math.hypot(point[0], point[1])
        if is_new:
            self._states = [(angle, 0.0) for angle in measured]
            self._covariance = (self._R, 0.0, 1.0)
        else:
            dt, (pp, pv, vv) = stamp - self.stamp, self._covariance
            pp += dt * (2.0 * pv + dt * vv) + self._Q * dt**3 / 3.0
            pv += dt * vv + 0.5 * self._Q * dt * dt
            vv += self._Q * dt
            k, by_speed = pp / (pp + self._R), pv / (pp + self._R)
            self._covariance = (pp - k * pp, pv - k * pv, vv - by_speed * pv)
            self._states = [
                (x + v * dt + k * (z - x - v * dt), v + by_speed * (z - x - v * dt))
                for (x, v), z in zip(self._states, measured, strict=True)
            ]
        self.stamp, self.point = stamp, point

    def expected(self, stamp: float) -> Point:
        """See `SimpleLaw`."""
        dt = min(stamp - self.stamp, self._LONGEST)
        pan, tilt = (x + v * dt for x, v in self._states)
        return in_base((self._distance, 0.0, 0.0), pan, tilt)

    def steer(self, now: float) -> HeadCommand:
        """See `SimpleLaw`."""
        dt = now + self._AHEAD - self.stamp
        is_held = dt > self._LONGEST
        here = angles_of(self.here(self.expected(now + self._AHEAD)))
        before = angles_of(self.here(self.expected(now + self._AHEAD - 0.02)))
        goals, speeds = [], []
        for index, at in enumerate(self.joints):
            velocity = 0.0 if is_held else (here[index] - before[index]) / 0.02
            speed = velocity + self._GAIN * (here[index] - at - 0.06 * velocity)
            goals.append(here[index] + 0.1 * velocity)
            speeds.append(min(max(abs(speed), 0.02), self.speed))
        return inside(*goals, *speeds)


class ReachyMini(SimpleLaw):
    """reachy_mini's arithmetic: exponential average (0.15 at 50 Hz), no history of the pose."""

    def __init__(self) -> None:
        super().__init__()
        self._average: tuple[float, float] | None = None

    def joints_at(self, stamp: float) -> tuple[float, float]:
        """Return pan and tilt as they are now."""
        return self.joints

    def steer(self, now: float) -> HeadCommand:
        """See `SimpleLaw`."""
        assert self.point is not None
        goal = angles_of(self.here(self.point))
        old = self._average or self.joints
        pan, tilt = (a + 0.15 * (b - a) for a, b in zip(old, goal, strict=True))
        self._average = pan, tilt
        return inside(pan, tilt, self.speed, self.speed)


def inside(pan: float, tilt: float, pan_speed: float, tilt_speed: float) -> HeadCommand:
    """Return the command, its goals within the joints' limits."""
    pan = min(max(pan, -_LIMITS[0]), _LIMITS[0])
    tilt = min(max(tilt, -_LIMITS[1]), 1.47)
    return HeadCommand(pan, tilt, pan_speed, tilt_speed)


def _apart(point: Point, other: Point) -> float:
    """Return the angle between two points of the base frame [rad]."""
    a, b = angles_of(point), angles_of(other)
    return math.hypot(a[0] - b[0], a[1] - b[1])
