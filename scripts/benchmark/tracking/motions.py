"""Where targets go: curves of the first editions, and people by minimum-jerk moves."""

import math
from bisect import bisect_right
from collections.abc import Callable
from random import Random

from plant import in_base
from runs import around, sine, still, stop_and_go

Point = tuple[float, float, float]
Path = Callable[[float], Point]

PAUSE_NEAR = 40.0  # s for which a person stands before the head


def triangle(speed: float, amplitude: float = 0.5) -> Path:
    """Turn on the spot at a speed [rad/s], with sharp turns."""
    rate = 0.25 * speed / amplitude
    return lambda t: around(amplitude * (4.0 * abs((rate * t) % 1.0 - 0.5) - 1.0))


def jumps(t: float) -> Point:
    """Jump by 0.4 rad every 2 s."""
    return around(0.2 if t % 4.0 >= 2.0 else -0.2)


def fictitious(t: float) -> Point:
    """The target of tutorial part 2 in the head's base frame (1 rad/s)."""
    s = math.sin(max(t, 0.0))
    return 0.5 + 0.25 * s, 0.5 * s, -0.318 + 0.5 * abs(s)


def as_turtlebot_sees(t: float) -> Point:
    """The same target on the turtlebot: a point at which this head has the turtlebot's angles.

    The turtlebot's tilt axis is 71.5 mm before and 83.5 mm above the frame of its target, and its
    camera 50 mm above the tilt axis.
    """
    s = math.sin(max(t, 0.0))
    x, y, z = 0.5 + 0.25 * s - 0.0715, 0.5 * s, -0.1 + 0.5 * abs(s) - 0.0835
    flat = math.hypot(x, y)
    tilt = math.asin(0.05 / math.hypot(flat, z)) - math.atan2(z, flat)
    return in_base((math.hypot(flat, z), 0.0, 0.0), math.atan2(y, x), tilt)


def drifting(speed: float) -> Path:
    """Go to and fro, 8 s each way [rad/s]."""
    return lambda t: around(speed * abs(t % 16.0 - 8.0))


def passing(distance: float) -> Path:
    """Walk past on a straight line [m], at 1 m/s."""
    return lambda t: (distance, t - 5.0, 0.1)


def coming(t: float) -> Point:
    """Come straight on, a little aside."""
    return 4.5 - 0.35 * t, 0.3, 0.1


def circle(t: float) -> Point:
    """Move to the sides, up and down, nearer and farther at once."""
    return around(0.4 * math.sin(1.5 * t), 0.2 + 0.2 * math.cos(1.5 * t), 2.0 + 0.3 * math.sin(t))


def two_tones(t: float) -> Point:
    """A slow swing with a faster one on it."""
    return around(0.3 * math.sin(1.3 * t) + 0.1 * math.sin(5.0 * t))


def wandering(t: float) -> Point:
    """Three slow tones."""
    tones = ((0.23, 0.3, 0.0), (0.37, 0.15, 1.0), (0.61, 0.06, 2.0))
    return around(sum(a * math.sin(math.tau * f * t + phase) for f, a, phase in tones))


PATHS: dict[str, Path] = {
    "still": still,
    "±0.5 rad, 0.2 Hz": sine(0.2),
    "±0.5 rad, 0.5 Hz": sine(0.5),
    "±0.5 rad, 1 Hz": sine(1.0),
    "to and fro at 0.5 rad/s": triangle(0.5),
    "stop and go": stop_and_go,
    "walks past at 1.5 m": passing(1.5),
    "walks past at 0.7 m": passing(0.7),
    "comes nearer": coming,
    "circle": circle,
    "two tones": two_tones,
    "wanders": wandering,
    "jumps": jumps,
    "fictitious, tutorial 2": fictitious,
}


class Person:
    """A face that moves as people do.

    Moves between places are minimum-jerk (Flash and Hogan 1985); a face also sways by some
    millimetres. Use it as a `Path`.
    """

    def __init__(
        self,
        rng: Random,  # draws everything
        duration: float,  # [s]
        # what the person may do, each as often as it is named
        acts: str = "move move move pass sit turns near",
        exam: bool = False,  # draw from wider ranges than in development
    ) -> None:
        self._rng, self._wide = rng, 1.25 if exam else 1.0
        self._starts: list[float] = []
        self._segments: list[tuple[float, Point, Point, bool]] = []
        self._now, self._height = 0.0, rng.uniform(0.15, 0.35) * self._wide
        self._place = self._somewhere()
        self._sways = [
            (rng.uniform(0.003, 0.01), rng.uniform(0.2, 0.8), rng.uniform(0.0, 6.3)) for _ in "xyz"
        ]
        self._stand(rng.uniform(0.5, 2.0))
        kinds, was_near = acts.split(), False
        while self._now < duration:
            act = rng.choice(kinds)
            if act == "near" and was_near:
                continue
            was_near = was_near or act == "near"
            getattr(self, f"_{act}")()

    def __call__(self, t: float) -> Point:
        """Return the place of the face at a time [s]."""
        index = max(bisect_right(self._starts, t) - 1, 0)
        duration, start, end, is_smooth = self._segments[index]
        s = min(max((t - self._starts[index]) / duration, 0.0), 1.0)
        s = s**3 * (10.0 - 15.0 * s + 6.0 * s * s) if is_smooth else s
        x, y, z = (
            a + s * (b - a) + size * math.sin(math.tau * rate * t + phase)
            for a, b, (size, rate, phase) in zip(start, end, self._sways, strict=True)
        )
        return x, y, z

    def _somewhere(self, nearest: float = 0.9) -> Point:
        rng, wide = self._rng, self._wide
        distance, bearing = rng.uniform(nearest, 3.0), rng.uniform(-0.7, 0.7) * wide
        height = self._height + rng.uniform(-0.05, 0.1)
        return distance * math.cos(bearing), distance * math.sin(bearing), height

    def _to(self, place: Point, speed: float, *, is_smooth: bool = True) -> None:
        """Move to a place at a mean speed [m/s]."""
        way = math.dist(place, self._place)
        self._add(place, max(way / speed, 0.5), is_smooth)

    def _add(self, place: Point, duration: float, is_smooth: bool = True) -> None:
        self._starts.append(self._now)
        self._segments.append((duration, self._place, place, is_smooth))
        self._now, self._place = self._now + duration, place

    def _stand(self, duration: float) -> None:
        self._add(self._place, duration)

    def _move(self) -> None:
        rng = self._rng
        self._to(self._somewhere(), rng.uniform(0.4, 1.2) * self._wide)
        self._stand(rng.uniform(0.2, 4.0))

    def _pass(self) -> None:
        rng, side = self._rng, self._rng.choice((-1.0, 1.0))
        x, y = rng.uniform(1.2, 2.5), rng.uniform(1.0, 1.5)
        self._to((x, side * y, self._height), 1.0)
        self._stand(rng.uniform(0.3, 1.0))
        self._to((x, -side * y, self._height), rng.uniform(0.8, 1.5) * self._wide)
        self._stand(rng.uniform(0.3, 2.0))

    def _sit(self) -> None:
        rng, (x, y, z) = self._rng, self._place
        self._add((x + 0.05, y, z - 0.45), rng.uniform(0.9, 1.5))
        self._stand(rng.uniform(3.0, 8.0))
        self._add((x, y, z), rng.uniform(0.9, 1.5))
        self._stand(rng.uniform(0.3, 1.0))

    def _turns(self) -> None:
        """Two persons speak in turn: the target jumps between them; the camera sees both."""
        rng, (x, y, z) = self._rng, self._place
        angle = rng.choice((-1.0, 1.0)) * rng.uniform(0.2, 0.42)
        c, s = math.cos(angle), math.sin(angle)
        other, until = (c * x - s * y, s * x + c * y, z + 0.1), self._now + 20.0
        places = [(x, y, z), other]
        while self._now < until:
            self._stand(rng.uniform(1.5, 6.0))
            places.reverse()
            self._place = places[0]
        self._stand(1.0)

    def _near(self) -> None:
        """Walk up to the head, stop abruptly, move on after a while."""
        rng = self._rng
        far = self._somewhere(2.2)
        self._to(far, 1.0)
        self._stand(rng.uniform(0.5, 2.0))
        near = rng.uniform(0.5, 0.8) / math.hypot(*far[:2])
        self._to((near * far[0], near * far[1], far[2]), rng.uniform(0.8, 1.6), is_smooth=False)
        self._stand(PAUSE_NEAR)
        self._to(self._somewhere(), rng.uniform(0.4, 1.0))
        self._stand(rng.uniform(0.5, 2.0))
