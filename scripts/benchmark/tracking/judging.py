"""Runs a controller in a situation and scores it; many of them on all processors."""

import math
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from closed_loop import START, ClosedLoop, Conditions
from plant import Pair, Streamed, angles
from runs import HEAD

from head_tracking.tracking import LAWS, HeadBase, SetpointStream, Tracker
from tracking.opponents import Kalman, ReachyMini, SimpleLaw, Tutorials
from tracking.situations import SITUATIONS

_AHEAD = 0.1  # s from now to the prediction whose deviation is judged
_SETTLED = 8.0  # s after which a learned delay counts
_WRITTEN = 0.0013  # s from a step to the command

OPPONENTS: dict[str, Callable[[], SimpleLaw]] = {
    "position": SimpleLaw,
    "kalman": Kalman,
    "tutorials": Tutorials,
    "reachy_mini": ReachyMini,
}


class Score(NamedTuple):
    """The result of a run; errors are from the first point to the end [mrad].

    Attributes:
        rms: of the error.
        worst: the largest error.
        last: rms of the last 15 s.
        oscillating: ratio of the steps in which the head was declared to oscillate.
        overshoot: how far a joint went beyond the range of its target, after the first second.
        nees: squared prediction error over stated variance, mean; nan: not measured.
        blind: ratio of the time in which no camera saw a target that was to be seen.
        delay: by how much a learned servo delay is off at most while its deviation says that it is
            not off by 3 deviations [ms]; nan: not measured.
        step, point: mean times, in gazes; what another process interrupted is left out.
    """

    rms: float
    worst: float
    last: float = math.nan
    oscillating: float = 0.0
    overshoot: float = 0.0
    nees: float = math.nan
    blind: float = 0.0
    delay: float = math.nan
    step: float = math.nan
    point: float = math.nan


@dataclass(frozen=True)
class Job:
    """One run, as it is given to a process."""

    situation: str
    seed: int
    who: str = "ours"
    exam: bool = False


def tracker(law: str, loop: ClosedLoop, conditions: Conditions) -> Tracker:
    """Make the package's tracker for a loop."""
    moves = conditions.base is not None
    base = HeadBase(loop.buffer, "odom", HEAD.base_frame) if moves else None
    return Tracker(HEAD, LAWS[law](HEAD, 1.0 / conditions.rate), base=base)


class _Watch:
    """Notes what the package's tracker states, step by step."""

    def __init__(self, loop: ClosedLoop, conditions: Conditions) -> None:
        self.tracker = tracker("predictive", loop, conditions)
        self.steps = self.oscillating = 0
        self.nees: list[float] = []
        self.delay = 0.0
        self._loop, self._servos = loop, conditions.servos
        self._moves = conditions.base is not None

    def observe(self, now: float) -> None:
        tracker = self.tracker
        self.steps += 1
        servos = self._servos
        if isinstance(servos, Pair) and not self.steps % 10 and now > _SETTLED:
            learned = tracker.law.servos.values()
            for servo, model in zip((servos.pan, servos.tilt), learned, strict=True):
                off = abs(model.mean - servo.dead_time - servo.lag - _WRITTEN)
                if servo.profile == math.inf and off > 3.0 * model.deviation:
                    self.delay = max(self.delay, off)
        self.oscillating += tracker.state.name == "CAUTIOUS"
        estimate = tracker.estimator.estimate
        if self._moves or self.steps % 5 or now < 2.0 or estimate is None:
            return
        time = now + _AHEAD
        if time + START - estimate.stamp > 0.5:
            return
        truth, expected = angles(self._loop.truth(time)), estimate.ray_at(time + START)[:2]
        deviations = [estimate.deviation(joint, time + START) for joint in (0, 1)]
        self.nees.append(
            sum(
                ((a - b) / max(d, 1e-6)) ** 2
                for a, b, d in zip(expected, truth, deviations, strict=True)
            )
            / 2.0
        )


@cache
def gaze_time() -> float:
    """Return the median time of one exact gaze [s]."""
    times = []
    for k in range(300):
        before = time.perf_counter()
        for j in range(10):
            HEAD.gaze((math.cos(0.003 * k), 0.5, 0.1 * j), 0.0, 0.0)
        times.append(time.perf_counter() - before)
    return float(np.median(times)) / 10.0


def cost(times: Sequence[float]) -> float:
    """Return a mean time in gazes, without what took 20 times the median: interruptions."""
    found = np.array(times or [math.nan])
    return float(found[~(found > 20.0 * np.median(found))].mean()) / gaze_time()


def judge(job: Job) -> Score:
    """Run a job."""
    path, conditions = SITUATIONS[job.situation].setup(job.seed, job.exam)
    watch: _Watch | None = None
    controller: Any
    if job.who == "ours":
        if isinstance(conditions.servos, Streamed):
            stream = replace(conditions.servos, stream=lambda: SetpointStream(0.02, 0.0))
            conditions = replace(conditions, servos=stream)
        loop = ClosedLoop(path, conditions, lambda now: watch.observe(now) if watch else None)
        watch = _Watch(loop, conditions)
        controller = watch.tracker
    else:
        controller = OPPONENTS[job.who]()
        rate = 10.0 if job.who == "tutorials" else 50.0
        loop = ClosedLoop(path, replace(conditions, rate=rate))
    outcome = loop.run(controller)
    if not outcome.seen:
        return Score(1e3 * outcome.recording.rms, 1e3 * outcome.recording.maximum)
    trace = outcome.recording.between(outcome.seen[0])
    late = trace.between(outcome.seen[0] + 1.0)
    beyond = np.maximum(
        late.positions - late.wanted.max(axis=0), late.wanted.min(axis=0) - late.positions
    )
    gaps = np.diff([*outcome.seen, conditions.duration])
    meant = sum(b - a for a, b in conditions.gaps)
    blind = max(float(gaps[gaps > 1.0].sum()) - meant, 0.0) / conditions.duration
    score = Score(
        1e3 * trace.rms,
        1e3 * trace.maximum,
        1e3 * trace.between(conditions.duration - 15.0).rms,
        overshoot=1e3 * max(float(beyond.max()), 0.0),
        blind=blind,
        step=cost(outcome.costs),
    )
    if watch is None:
        return score
    return score._replace(
        oscillating=watch.oscillating / watch.steps,
        delay=1e3 * watch.delay,
        nees=float(np.mean(watch.nees)) if watch.nees else math.nan,
        point=cost(outcome.point_costs),
    )


def judge_all(jobs: Iterable[Job]) -> dict[Job, Score]:
    """Run jobs on all processors."""
    listed = list(jobs)
    with ProcessPoolExecutor() as pool:
        return dict(zip(listed, pool.map(judge, listed, chunksize=2), strict=True))
