"""Situations by which tracking is judged; each draws its target, servos and conditions from a seed.

Helpers and developers use any seeds. An exam draws from wider ranges, and its seeds are not used
while something is being tuned.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from random import Random
from typing import NamedTuple

from closed_loop import WEBCAM, Camera, Conditions, ax12
from plant import Pair, PlainServo, Streamed, angles

from tracking.motions import (
    PATHS,
    Path,
    Person,
    around,
    as_turtlebot_sees,
    drifting,
    fictitious,
    sine,
    triangle,
)

GOOD = Conditions(noise=0.002, delay=0.1, on_head=True)
"""The first editions' conditions: 30 points a second, 100 ms late, 2 mrad."""


SHARP = Conditions(duration=20.0, points=40.0)
"""A target that is published, not seen: nothing is random."""


class Setup(NamedTuple):
    """What is run."""

    path: Path
    conditions: Conditions


Make = Callable[[Random, bool], Setup]


@dataclass(frozen=True)
class Situation:
    """One row of a table."""

    family: str  # by which it is chosen
    name: str  # of the row
    make: Make  # draws the target and the conditions; told whether it is an exam
    without: str = ""  # the row with which errors are compared; empty: none

    def setup(self, seed: int, exam: bool) -> Setup:
        """Draw the run of a seed; the head begins near its target."""
        rng = Random(f"{self.name}/{seed}/{exam}")
        path, conditions = self.make(rng, exam)
        if conditions.start == (0.0, 0.0):
            pan, tilt = angles(path(0.0))
            off = 0.15 if isinstance(path, Person) else 0.03
            start = max(min(pan, 2.5), -2.5) + rng.uniform(-off, off), tilt
            conditions = replace(conditions, start=start)
        return Setup(path, replace(conditions, seed=rng.getrandbits(30)))


def servos(rng: Random, exam: bool, slowest: float = 0.05) -> Pair:
    """Draw different servos for pan and tilt."""
    drawn = (PlainServo.drawn(rng, (0.005, slowest), exam) for _ in range(2))
    return Pair(*drawn)


def people(duration: float, base: Conditions = WEBCAM, acts: str = "") -> Make:
    """A person in front of a head with drawn servos."""

    def make(rng: Random, exam: bool) -> Setup:
        path = Person(rng, duration, *([acts] if acts else []), exam=exam)
        made = servos(rng, exam)
        return Setup(path, replace(base, duration=duration, servos=made))

    return make


def fixed(path: Path, conditions: Conditions) -> Make:
    """The same target and conditions for all seeds but for noise; an exam changes the target.

    The target begins at rest and comes to its speed within 2 s.
    """

    def make(rng: Random, exam: bool) -> Setup:
        faster, aside = (rng.uniform(0.9, 1.1), rng.uniform(-0.15, 0.15)) if exam else (1.0, 0.0)
        c, s = math.cos(aside), math.sin(aside)

        def moved(t: float) -> tuple[float, float, float]:
            x, y, z = path(faster * (0.25 * t * t if t < 2.0 else t - 1.0))
            return c * x - s * y, s * x + c * y, z

        return Setup(moved, conditions)

    return make


def near(rng: Random, exam: bool) -> Setup:
    """A walk straight up to the head that ends abruptly; 40 s later the person moves again."""
    speed, bearing = rng.uniform(0.8, 1.6), rng.uniform(-0.5, 0.5)
    far, close = rng.uniform(2.5, 4.0), rng.uniform(0.4, 0.7)
    arrives = 2.0 + (far - close) / speed

    def path(t: float) -> tuple[float, float, float]:
        distance = min(max(far - speed * (t - 2.0), close), far)
        moving = max(t - arrives - 40.0, 0.0)
        return around(bearing + 0.4 * math.sin(0.9 * moving) * min(moving, 1.0), 0.16, distance)

    base = replace(WEBCAM, points=rng.choice((15.0, 30.0)), duration=arrives + 60.0)
    return Setup(path, replace(base, servos=servos(rng, exam)))


def any_servo(rng: Random, exam: bool) -> Setup:
    """A random servo, target and camera."""
    name = rng.choice([name for name in PATHS if name != "still"])
    path, _ = fixed(PATHS[name], GOOD)(rng, exam)
    conditions = Conditions(
        duration=14.0,
        noise=rng.choice((0.0, 0.002, 0.005)),
        delay=rng.choice((0.0, 0.05, 0.1)),
        on_head=rng.random() < 0.5,
        servos=servos(rng, exam, 0.15),
    )
    return Setup(path, conditions)


def sway(amplitude: float, frequency: float) -> Callable[[float], tuple[float, float, float]]:
    """A base that turns to and fro [rad, Hz], more and more within 2 s."""
    return lambda t: (
        0.0,
        0.0,
        min(0.5 * t, 1.0) * amplitude * math.sin(math.tau * frequency * t),
    )


def drive(t: float) -> tuple[float, float, float]:
    """A base that drives an arc to and fro, at up to 1 rad/s."""
    yaw = math.sin(0.25 * t * t if t < 2.0 else t - 1.0)
    return 0.3 * math.sin(yaw), 0.1 * yaw, yaw


def pursuit(t: float) -> tuple[float, float, float]:
    """Bahill and McDonald 1983: a smooth target of +-10 degrees, 0.3 Hz, cubic between turns."""
    phase = (0.3 * t) % 1.0
    half = 2.0 * phase if phase < 0.5 else 2.0 - 2.0 * phase
    return around(math.radians(10.0) * (2.0 * half * half * (3.0 - 2.0 * half) - 1.0), 0.16)


Changes = dict[str, dict[str, object]]
"""Changes of conditions, by the name of the trouble."""

HEAVY: Changes = {
    "at most 5 rad/s²": {"servos": PlainServo(acceleration=5.0)},
    "at most 10 rad/s²": {"servos": PlainServo(acceleration=10.0)},
    "80 ms dead time, 15 rad/s²": {"servos": PlainServo(dead_time=0.08, acceleration=15.0)},
}
SERVOS: Changes = {
    **{f"dead time {ms} ms": {"servos": PlainServo(ms / 1e3)} for ms in (10, 60, 100, 150)},
    "lag 80 ms": {"servos": PlainServo(lag=0.08)},
    "at most 2 rad/s": {"servos": PlainServo(speed=2.0)},
    "play 10 mrad": {"servos": PlainServo(play=0.01)},
    "dead band 10 mrad": {"servos": PlainServo(dead_band=0.01)},
    "profile 20 rad/s²": {"servos": PlainServo(profile=20.0)},
    "profile 40 rad/s², lag 77 ms": {"servos": PlainServo(profile=40.0, lag=0.077)},
    **HEAVY,
}
SWING, SLOW = "±0.5 rad, 0.5 Hz", "±0.5 rad, 0.2 Hz"
TRACKS = ("still", SLOW, SWING, "circle", "stop and go", "jumps")
GAPS: Changes = {
    "gap of 0.3 s": {"gaps": tuple((t, t + 0.3) for t in range(3, 20, 3))},
    "gap of 0.8 s": {"gaps": tuple((t + 0.2, t + 1.0) for t in range(3, 20, 3))},
    "gap of 1.5 s": {"gaps": tuple((t + 0.4, t + 1.9) for t in range(3, 20, 4))},
    "50 % lost in bursts": {"lost": 0.5, "outage": 0.3},
    "70 % lost in bursts": {"lost": 0.7, "outage": 0.4},
}
SELDOM: Changes = {
    "5 a second, 400 ms late": {"points": 5.0, "delay": 0.4, "delay_jitter": 0.05},
    "8 a second, 300 ms late": {"points": 8.0, "delay": 0.3, "delay_jitter": 0.05},
}
CAMERAS: Changes = {
    **SELDOM,
    "15 a second, 120 ms late, out of order": {"points": 15.0, "delay": 0.12, "delay_jitter": 0.07},
    "60 a second, at once": {"points": 60.0, "delay": 0.0},
    "in batches of 0.2 s": {"batch": 0.2, "delay": 0.05},
    "5 % outliers": {"outliers": 0.05, "outlier": 0.3},
    "irregular, 20 % lost": {"jitter": 0.2, "lost": 0.2},
    "distance with 20 % noise": {"range_noise": 0.2},
    "turned by 30 mrad": {"extrinsic": (0.03, -0.02)},
    "second camera, 5 a second, 300 ms late": {
        "more": (Camera(points=5.0, delay=0.3, noise=0.005, on_head=True),)
    },
}
LATE: Changes = {
    "10 % of steps 60 to 150 ms late": {"late": 0.1},
    "30 % of steps 60 to 150 ms late": {"late": 0.3},
}
JITTER = {"stamp_jitter": 0.0115}
STAMPS: Changes = {
    f"stamps {ms:+d} ms": {"stamp_error": ms / 1e3, **JITTER} for ms in (-120, -80, 50, 90, 200)
}
BASES: Changes = {
    "base sways ±0.4 rad at 0.5 Hz": {"base": sway(0.4, 0.5)},
    "base sways ±0.2 rad at 0.25 Hz": {"base": sway(0.2, 0.25)},
    "base drives at up to 1 rad/s": {"base": drive},
}


def _on_paths(
    family: str, names: Sequence[str], conditions: Conditions, troubles: Changes
) -> list[Situation]:
    """Every trouble on every path."""
    return [
        Situation(family, f"{name}: {trouble}", fixed(PATHS[name], replace(conditions, **change)))
        for trouble, change in troubles.items()
        for name in names
    ]


def _on_person(family: str, duration: float, troubles: Changes) -> list[Situation]:
    """Every trouble for a person in front of a webcam."""
    return [
        Situation(family, f"person: {trouble}", people(duration, replace(WEBCAM, **change)))
        for trouble, change in troubles.items()
    ]


def _families() -> list[Situation]:
    long = replace(GOOD, duration=20.0, servos=PlainServo())
    web = replace(WEBCAM, duration=20.0, servos=PlainServo())
    found = [
        Situation("mixed", "mixed human-like motion", people(180.0)),
        Situation("near", "walks up, stops, moves again", near),
        Situation("turns", "two persons in turn", people(60.0, acts="turns")),
        Situation("servos", "random servos", any_servo),
        Situation(
            "pursuit", "Bahill and McDonald 1983", fixed(pursuit, replace(long, noise=0.001))
        ),
    ]
    found += [
        Situation("ordinary", name, fixed(path, replace(GOOD, duration=14.0, servos=ax12())))
        for name, path in PATHS.items()
    ]
    found += [
        Situation("drift", f"{speed} mrad/s, {name}", fixed(drifting(speed / 1e3), conditions))
        for name, conditions in (
            ("AX-12", replace(GOOD, duration=26.0, servos=ax12())),
            ("another servo", replace(long, duration=26.0)),
            ("another servo, webcam", replace(web, duration=26.0)),
        )
        for speed in (3, 6, 15, 30)
    ]
    found += [
        Situation("sharp", f"{name}, {ms} ms late", fixed(path, replace(SHARP, delay=ms / 1e3)))
        for ms in (0, 50)
        for name, path in (
            ("fictitious", fictitious),
            ("as the turtlebot sees it", as_turtlebot_sees),
            ("to and fro at 0.5 rad/s", triangle(0.5)),
        )
    ]
    both = (SLOW, SWING)
    found += _on_paths("gaps", both, long, GAPS) + _on_person("gaps", 20.0, GAPS)
    found += _on_paths("late", both, long, LATE) + _on_person("late", 30.0, LATE)
    for name in ("still", "circle", SLOW, SWING):
        plain = f"{name}: stamps ±20 ms"
        found.append(Situation("stamps", plain, fixed(PATHS[name], replace(long, **JITTER))))
        troubles = {f"{trouble} ±20 ms": change for trouble, change in STAMPS.items()}
        found += [
            replace(situation, without=plain)
            for situation in _on_paths("stamps", (name,), long, troubles)
        ]
    found += _on_paths("base", ("still", SLOW), long, BASES)
    found += _on_paths("heavy", both, long, HEAVY)
    found += [
        Situation(
            "trajectory",
            f"{frequency:g} Hz: controller {ms} ms late",
            fixed(sine(frequency), replace(GOOD, duration=60.0, servos=Streamed(ms / 1e3))),
        )
        for ms in (50, 100, 200)
        for frequency in (0.25, 0.5)
    ]
    found += _on_paths("slow", TRACKS, web, SELDOM) + _on_person("slow", 30.0, SELDOM)
    return found + _table(long)


def _table(good: Conditions) -> list[Situation]:
    """About 300 cases: every trouble on every track and for a person, each once."""
    groups = {"servo": SERVOS, "camera": CAMERAS, "gaps": GAPS, "late": LATE}
    groups |= {"stamps": STAMPS, "base": BASES}
    troubles: Changes = {
        **{f"{group}: {name}": change for group, each in groups.items()
           for name, change in each.items()},
        **{f"controller {ms} ms late": {"servos": Streamed(ms / 1e3)} for ms in (50, 100, 200)},
    }  # fmt: skip
    drawn = [
        Situation("table", f"person 1: {trouble}", _person_with(change))
        for trouble, change in troubles.items()
    ]
    return _on_paths("table", TRACKS, good, troubles) + drawn


def _person_with(change: dict[str, object]) -> Make:
    def make(rng: Random, exam: bool) -> Setup:
        path, conditions = people(20.0)(rng, exam)
        return Setup(path, replace(conditions, **change))

    return make


SITUATIONS = {situation.name: situation for situation in _families()}
FAMILIES = tuple(dict.fromkeys(situation.family for situation in SITUATIONS.values()))
