"""The tutorials' law and the predictive law side by side, on the simulated bus down to the bytes.

Everything runs in simulated time: the figures are the same on every machine, but for the costs.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path as File

from perfect_command import PerfectCommand

from head_tracking.gaze import PanTiltHead
from head_tracking.share import robot_file
from head_tracking.simulation import SimulatedServo
from head_tracking.tracking import (
    LAWS,
    EstimatorParameters,
    LawParameters,
    Recording,
    SpeedLimits,
    TargetStateParameters,
    Tracker,
    picture,
)
from head_tracking.transforms import Vector3, load_robot_model
from head_tracking.trial import Conditions, HeadTrial, Outcome, Path

HEAD = PanTiltHead(
    load_robot_model(robot_file("kinectbot")),
    "head_pan_joint",
    "head_tilt_joint",
    "camera_link",
    tilt_limits=(-1.08, 1.47),
)
DOCS = File(__file__).parents[1] / "docs"
NOISE = 0.002  # rad
LATE = 0.1  # s
DISTANCE = 2.0  # m
LEVEL = 0.08  # m above the pan joint


def around(bearing: float) -> Vector3:
    """A point in front of the camera, at a bearing [rad]."""
    return DISTANCE * math.cos(bearing), DISTANCE * math.sin(bearing), LEVEL


def sine(frequency: float) -> Path:
    """Swings by 0.5 rad."""
    return lambda t: around(0.5 * math.sin(math.tau * frequency * t))


def ramp(t: float) -> Vector3:
    """1 rad/s."""
    return around(-2.0 + min(max(t, 0.0), 4.0))


def step(t: float) -> Vector3:
    """0.5 rad after 2 s."""
    return around(0.5 if t >= 2.0 else 0.0)


def rest(t: float) -> Vector3:
    """Stands still."""
    return around(0.3)


def fictitious(t: float) -> Vector3:
    """The target of tutorial part 2, as seen from the pan joint."""
    s = math.sin(max(t, 0.0))
    x, y, z = TORSO @ (0.5 + 0.25 * s, 0.5 * s, -0.1 + 0.5 * abs(s))
    return x, y, z


TORSO = load_robot_model(robot_file("kinectbot")).transform(HEAD.base_frame, "torso_link", {})


@dataclass(frozen=True)
class Course:
    """A target, and how much smaller than the tutorials' law's its error is to be.

    Attributes:
        name: for the table.
        path: of the target.
        duration: [s].
        judged: from when to when [s].
        wanted: ratios without a delay and with one.
        start: pan at first [rad].
    """

    name: str
    path: Path
    duration: float
    judged: tuple[float, float]
    wanted: tuple[float, float]
    start: float = 0.0


COURSES = (
    Course("±0.5 rad, 0.2 Hz", sine(0.2), 22.0, (2.0, 22.0), (60, 30)),
    Course("±0.5 rad, 0.5 Hz", sine(0.5), 14.0, (2.0, 14.0), (30, 10)),
    Course("±0.5 rad, 1 Hz", sine(1.0), 10.0, (2.0, 10.0), (8, 2)),
    Course("ramp 1 rad/s", ramp, 4.0, (1.5, 3.95), (100, 60), -2.0),
    Course("fictitious, tutorial 2", fictitious, 2.0 + 4.0 * math.pi, (2.0, 99.0), (20, 10)),
)

TUTORIAL = LawParameters(limits=SpeedLimits(max_joint_speed=2.0))


def tutorial() -> Tracker:
    """The tutorials' law, k = 1.5, cap 2.0 rad/s."""
    law = LAWS["speed"](HEAD, 0.1, TUTORIAL)
    return Tracker(HEAD, law, EstimatorParameters(), TargetStateParameters())


def ours() -> Tracker:
    """The predictive law with its default parameters."""
    law = LAWS["predictive"](HEAD, 0.02, LawParameters())
    return Tracker(HEAD, law, EstimatorParameters(), TargetStateParameters())


def slow(servo: SimulatedServo) -> None:
    """Its mechanics take twice the time."""
    servo.inertia *= 2.0


def weak(servo: SimulatedServo) -> None:
    """Its top speed is 4 rad/s: a low supply."""
    servo.set_register("Min Voltage Limit", 50)
    servo.supply_voltage = 12.0 * 4.0 / 6.178


def soft(servo: SimulatedServo) -> None:
    """Its compliance slope is twice the usual one."""
    for side in ("CW", "CCW"):
        servo.set_register(f"{side} Compliance Slope", 64)


SERVOS: dict[str, Callable[[SimulatedServo], object]] = {
    "AX-12": lambda servo: None,
    "lag doubled": slow,
    "top speed 4 rad/s": weak,
    "compliance slope doubled": soft,
}


def tracking() -> str:
    """The tables of docs/results.md."""
    title = "| Servo | Target | Points | Tutorials', mrad | Ours, mrad | Ratio | Asked | Limit |"
    rows = [
        row(name, course, late) for name in SERVOS for course in COURSES for late in (False, True)
    ]
    draw()
    tables = [[title, "|---|---|---|---|---|---|---|---|", *rows], calmness(), steps(), [cost()]]
    return "\n\n".join("\n".join(table) for table in tables)


def draw() -> None:
    """Both laws on one target, as pictures."""
    conditions = Conditions(10.0, noise=NOISE, delay=LATE)
    for name, controller, rate in (("speed", tutorial, 10.0), ("predictive", ours, 50.0)):
        recording = run(sine(0.5), replace(conditions, rate=rate), controller()).between(2.0)
        title = f"law {name}: ±0.5 rad at 0.5 Hz, 2 mrad noise, 100 ms late"
        (DOCS / f"tracking_{name}.svg").write_text(picture(recording, title))


def row(name: str, course: Course, late: bool) -> str:
    """One target on one servo."""
    conditions = Conditions(
        course.duration,
        delay=LATE if late else 0.0,
        noise=NOISE,
        start=(course.start, 0.0),
        servo=SERVOS[name],
    )
    theirs = run(course.path, replace(conditions, rate=10.0), tutorial()).between(*course.judged)
    own = run(course.path, conditions, ours()).between(*course.judged)
    perfect = PerfectCommand(HEAD, course.path, 1_000.0, 0.02)
    limit = run(course.path, conditions, perfect).between(*course.judged)
    wanted = course.wanted[late] * (1.0 if name == "AX-12" else 0.7)
    ratio = theirs.rms / own.rms
    return (
        f"| {name} | {course.name} | {'100 ms late' if late else 'at once'} | "
        f"{1e3 * theirs.rms:.0f} | {1e3 * own.rms:.1f} | {bold(ratio, ratio >= wanted)} | "
        f"{wanted:.3g}x | {1e3 * limit.rms:.1f} |"
    )


def bold(ratio: float, reached: bool) -> str:
    """A ratio; bold if it is what was asked for."""
    return f"**{ratio:.0f}x**" if reached else f"{ratio:.1f}x"


def run(path: Path, conditions: Conditions, controller: object) -> Recording:
    """A trial."""
    return trial(path, conditions, controller).recording


def trial(path: Path, conditions: Conditions, controller: object) -> Outcome:
    """A trial with all that came of it."""
    return HeadTrial(HEAD, path, conditions).run(controller)  # type: ignore[arg-type]


def calmness() -> list[str]:
    """Jerk, and rest."""
    rows = ["| Calm | Tutorials' | Ours | Asked |", "|---|---|---|---|"]
    for noise, factor in ((0.0, 2), (NOISE, 5)):
        conditions = Conditions(22.0, noise=noise)
        theirs = run(sine(0.2), replace(conditions, rate=10.0), tutorial()).between(2.0).jerk()
        own = run(sine(0.2), conditions, ours()).between(2.0).jerk()
        rows.append(
            f"| mean jerk at 0.2 Hz, {1e3 * noise:.0f} mrad noise, rad/s³ | {theirs:.0f} | "
            f"{own:.0f}: **{own / theirs:.1f}x** | {factor}x at most |"
        )
    still = Conditions(20.0, noise=NOISE, start=(0.0, 0.0))
    theirs = run(rest, replace(still, rate=10.0), tutorial()).between(4.0).rms
    own = run(rest, still, ours()).between(4.0).rms
    rows.append(
        f"| error at rest, 2 mrad noise, mrad rms | {1e3 * theirs:.1f} | {1e3 * own:.1f} | "
        "under 3 |"
    )
    shares = [
        unchanged(trial(rest, replace(still, noise=0.0, rate=rate), controller()).goals)
        for rate, controller in ((10.0, tutorial), (50.0, ours))
    ]
    rows.append(
        "| bus cycles without another goal, no noise | "
        f"{100 * shares[0]:.0f} % | {100 * shares[1]:.0f} % | 95 % |"
    )
    return rows


def unchanged(goals: list[tuple[int, int]]) -> float:
    """The share of the cycles that repeat the goals of the one before, from 2 s on."""
    late = goals[100:]
    return statistics.fmean(a == b for a, b in pairwise(late))


def steps() -> list[str]:
    """A target that jumps by 0.5 rad."""
    rows = [
        "| Step of 0.5 rad | within 20 mrad after, s | overshoot, mrad |",
        "|---|---|---|",
    ]
    for name, noise in (("ours, no noise", 0.0), ("ours, 2 mrad noise", NOISE), ("asked", None)):
        if noise is None:
            rows.append("| asked | 0.4 | 10 |")
            continue
        recording = run(step, Conditions(4.0, noise=noise), ours()).between(2.0)
        pan, wanted = recording.positions[:, 0], recording.wanted[:, 0]
        rows.append(
            f"| {name} | {recording.settled(0.02) - 2.0:.2f} | "
            f"{max(0.0, 1e3 * float((pan - wanted).max())):.1f} |"
        )
    return rows


def cost() -> str:
    """What a step of the loop takes."""
    outcomes = {
        name: trial(sine(0.5), Conditions(10.0, noise=NOISE), controller())
        for name, controller in (("tutorials'", tutorial), ("ours", ours))
    }
    gaze = 1e6 * statistics.median(timed_gazes())
    figures = "; ".join(
        f"{name} {1e6 * statistics.median(outcome.costs):.0f} us a step, "
        f"{1e6 * statistics.median(outcome.point_costs):.0f} us a point"
        for name, outcome in outcomes.items()
    )
    return f"Costs, medians on this machine, where one exact gaze takes {gaze:.0f} us: {figures}."


def timed_gazes() -> list[float]:
    """What one gaze takes [s], again and again."""
    costs = []
    for k in range(500):
        before = time.perf_counter()
        HEAD.gaze(around(0.001 * k), 0.0, 0.0)
        costs.append(time.perf_counter() - before)
    return costs
