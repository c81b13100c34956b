"""A target, a head, and whatever turns the head: one run, in simulated time."""

from __future__ import annotations

import heapq
import math
import random
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from head_tracking.gaze import HeadCommand, PanTiltHead
from head_tracking.simulation import SimulatedServo
from head_tracking.tracking import Recording, Sample, TrackingStep
from head_tracking.transforms import Vector3
from head_tracking.trial.simulated_head import SimulatedHead

Path = Callable[[float], Vector3]
"""Where a target is [m], in the head's base frame, at a time [s]."""

_START = 1_000.0  # s
_SAMPLES = 250.0  # of the truth, a second
_READ = 0.0045  # s from the start of a cycle until its reading is known to everybody
_STEP = 0.0085  # s by which the tracker's steps come after the bus's cycles
_SEEN = 0.0031  # s by which the points come after the cycles


class Controller(Protocol):
    """What turns a head; `Tracker` is one."""

    def joints_read(self, stamp: float, positions: tuple[float, float]) -> None:
        """Takes pan and tilt [rad] as measured at `stamp` [s]."""

    def target_seen(self, stamp: float, point: Vector3, now: float) -> object:
        """Takes a point [m] that was seen at `stamp` [s]."""

    def step(self, now: float) -> TrackingStep:
        """What to do now."""


@dataclass(frozen=True, slots=True)
class Conditions:
    """What a trial is like.

    Attributes:
        duration: [s].
        rate: commands a second.
        cycles: of the bus, a second.
        points: of the target, a second.
        delay: age of a point when it comes [s].
        noise: standard deviation of its bearing, in both directions [rad].
        start: pan and tilt at first [rad].
        seed: of the noise.
        servo: makes the servos others than usual.
        spoil: what becomes of a point (time, place) on its way; None: it is lost.
    """

    duration: float
    rate: float = 50.0
    cycles: float = 50.0
    points: float = 30.0
    delay: float = 0.0
    noise: float = 0.0
    start: tuple[float, float] = (0.0, 0.0)
    seed: int = 1
    servo: Callable[[SimulatedServo], object] = lambda servo: None
    spoil: Callable[[float, Vector3], Vector3 | None] = lambda time, point: point


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a trial.

    Attributes:
        recording: of the true angles.
        commands: time [s] and command.
        goals: ticks that were written, cycle by cycle.
        costs: of each step [s].
        point_costs: of taking each point [s].
    """

    recording: Recording
    commands: list[tuple[float, HeadCommand]] = field(default_factory=list)
    goals: list[tuple[int, int]] = field(default_factory=list)
    costs: list[float] = field(default_factory=list)
    point_costs: list[float] = field(default_factory=list)


class HeadTrial:
    """Runs a controller against simulated servos."""

    def __init__(self, head: PanTiltHead, path: Path, conditions: Conditions) -> None:
        self._head = head
        self._path = path
        self._conditions = conditions
        self._servos = SimulatedHead(conditions.start, conditions.servo)
        self._random = random.Random(conditions.seed)

    def run(self, controller: Controller) -> Outcome:
        """One run from the start to the end."""
        outcome = Outcome(Recording())
        readings: list[tuple[float, float, tuple[float, float]]] = []
        for now, kind, at in self._events():
            if kind == "cycle":
                stamp, positions = self._servos.cycle(_ns(now))
                readings.append((now + _READ, _START + stamp * 1e-9, positions))
                if self._servos.goals is not None:
                    outcome.goals.append(self._servos.goals)
            elif kind == "point":
                point = self._seen(at)
                if point is not None:
                    before = time.perf_counter()
                    controller.target_seen(_START + at, point, _START + now)
                    outcome.point_costs.append(time.perf_counter() - before)
            elif kind == "truth":
                self._judge(now, outcome.recording)
            else:
                while readings and readings[0][0] <= now:
                    controller.joints_read(*readings.pop(0)[1:])
                before = time.perf_counter()
                command = controller.step(_START + now).command
                outcome.costs.append(time.perf_counter() - before)
                if command is not None:
                    self._servos.command(command)
                    outcome.commands.append((now, command))
        return outcome

    def _events(self) -> list[tuple[float, str, float]]:
        """Time, what happens, and the time that it is about [s]; in order."""
        c = self._conditions
        streams = (
            ((k / c.cycles, "cycle", k / c.cycles) for k in range(int(c.duration * c.cycles))),
            (
                (at + c.delay, "point", at)
                for at in (k / c.points + _SEEN for k in range(int(c.duration * c.points)))
            ),
            ((k / c.rate + _STEP, "step", 0.0) for k in range(int(c.duration * c.rate))),
            ((k / _SAMPLES + 0.0035, "truth", 0.0) for k in range(int(c.duration * _SAMPLES))),
        )
        return list(heapq.merge(*streams))

    def _seen(self, at: float) -> Vector3 | None:
        c = self._conditions
        point = self._path(at)
        noise = self._random.gauss(0.0, c.noise), self._random.gauss(0.0, c.noise)
        return c.spoil(at, turned(point, *noise) if c.noise else point)

    def _judge(self, now: float, recording: Recording) -> None:
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
