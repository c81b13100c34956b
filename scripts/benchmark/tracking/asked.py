"""What is asked of tracking, beside what was measured: a row for each family that was run."""

import statistics
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace

from tracking.judging import Job, Score
from tracking.situations import SITUATIONS

Scores = dict[Job, Score]
Measure = Callable[[Scores, Scores], str]


def simple(scores: Scores, job: Job) -> float:
    """Return the error of the better simple law in the same run [mrad]."""
    return min(scores[replace(job, who=law)].rms for law in ("position", "kalman"))


def cases(scores: Scores) -> str:
    """Return which cases are worse than a simple law by more than 5 %."""
    worse = [
        (ratio, f"{ratio:.2f} of {law}: {job.situation} (seed {job.seed})")
        for law in ("position", "kalman")
        for job, ratio in _over(scores, law).items()
        if not ratio <= 1.05
    ]
    return "\n".join(line for _, line in sorted(worse, reverse=True))


def _over(scores: Scores, law: str) -> dict[Job, float]:
    """Return the error of each case over that of a law in the same run."""
    return {
        job: score.rms / scores[replace(job, who=law)].rms
        for job, score in scores.items()
        if job.who == "ours"
    }


def _worse(ours: Scores, scores: Scores) -> str:
    parts = []
    for law in ("position", "kalman"):
        ratios = list(_over(scores, law).values())
        count = sum(not ratio <= 1.05 for ratio in ratios)
        far = sum(not ratio <= 1.2 for ratio in ratios)
        parts.append(f"{law}: {count} ({far} by more than 20 %), worst {max(ratios):.2f}")
    return f"of {len(ours)} cases: {'; '.join(parts)}"


def asked(families: dict[str, Scores]) -> str:
    """Return the rows of all families that were run."""
    rows = ["| Judged | measured | asked |", "|---|---|---|"]
    for family, scores in families.items():
        ours = {job: score for job, score in scores.items() if job.who == "ours"}
        measured = [
            _FIGURES.get(family, (family, _errors, "")),
            (f"{family}: declared to oscillate", _wrong, "never"),
        ]
        if family == "mixed":
            measured.append(("mean processor time of a point, a step, in gazes", _costs, "20, 10"))
        rows += [
            f"| {what} | {measure(ours, scores)} | {asked} |" for what, measure, asked in measured
        ]
    return "\n".join(rows)


def _wrong(ours: Scores, scores: Scores) -> str:
    share = statistics.fmean(score.oscillating for score in ours.values())
    return f"{100.0 * share:.1f} % of the time"


def _costs(ours: Scores, scores: Scores) -> str:
    point, step = (
        statistics.fmean(getattr(score, name) for score in ours.values())
        for name in ("point", "step")
    )
    return f"{point:.0f}, {step:.0f}"


def _errors(ours: Scores, scores: Scores) -> str:
    errors = [score.rms for score in ours.values()]
    return f"{statistics.median(errors):.1f}, worst {max(errors):.1f} mrad"


def _ratios(ours: Scores, scores: Scores) -> str:
    ratios = [score.rms / simple(scores, job) for job, score in ours.items()]
    return f"{statistics.median(ratios):.2f}, {max(ratios):.2f}"


def _not_followed(ours: Scores, scores: Scores) -> str:
    return f"{sum(not score.last < 150.0 for score in ours.values())} of {len(ours)}"


def _runaways(ours: Scores, scores: Scores) -> str:
    beyond = sum(not score.worst < 1e3 for score in ours.values())
    return f"{beyond}; {sum(score.delay > 60.0 for score in ours.values())} of {len(ours)}"


def _overshoot(ours: Scores, scores: Scores) -> str:
    return f"{max(score.overshoot for score in ours.values()):.0f}"


def _nees(ours: Scores, scores: Scores) -> str:
    paths = defaultdict(list)
    for job, score in ours.items():
        if job.situation != "jumps":  # no prediction can know of them
            paths[job.situation].append(score.nees)
    medians = {name: statistics.median(found) for name, found in paths.items()}
    lowest, highest = min(medians, key=medians.__getitem__), max(medians, key=medians.__getitem__)
    return f"{medians[lowest]:.2f} ({lowest}) to {medians[highest]:.2f} ({highest})"


def _largest(*named: str) -> Measure:
    """Measure the largest error of the curves whose situation has each of these in its name."""

    def measure(ours: Scores, scores: Scores) -> str:
        found = [
            max(
                score.rms
                for job, score in ours.items()
                if name in job.situation and not job.situation.startswith("person")
            )
            for name in named
        ]
        return ", ".join(f"{error:.0f}" for error in found)

    return measure


def _stamps(ours: Scores, scores: Scores) -> str:
    """The largest ratio of medians, and the largest error of a single seed [mrad]."""
    errors = defaultdict(list)
    for job, score in ours.items():
        errors[job.situation].append(score.rms)
    ratios = [
        statistics.median(found) / statistics.median(errors[SITUATIONS[name].without])
        for name, found in errors.items()
        if SITUATIONS[name].without in errors
    ]
    return f"{max(ratios):.2f}; {max(map(max, errors.values())):.0f}"


_FIGURES: dict[str, tuple[str, Measure, str]] = {
    "table": ("worse than a simple law by more than 5 %", _worse, "3; 10; none by 20 %"),
    "mixed": ("over the better of `position` and Kalman: median, worst", _ratios, "0.75, 1.05"),
    "near": ("walks up, stops, moves again: not followed", _not_followed, "0"),
    "servos": ("random servos: beyond 1 rad; delay false by over 60 ms", _runaways, "0; 0"),
    "stamps": ("wrong stamps over right ones: worst path; largest rms", _stamps, "1.5; 40"),
    "gaps": ("overshoot after gaps, mrad", _overshoot, "60"),
    "late": ("10 % of steps 60 to 150 ms late, mrad", _largest(": 10 %"), "60"),
    "base": ("base sways ±0.4 rad at 0.5 Hz, mrad", _largest("±0.4 rad"), "10"),
    "trajectory": (
        "trajectory controller 50, 100, 200 ms late, mrad",
        _largest(" 50 ms", " 100 ms", " 200 ms"),
        "15, 25, 60",
    ),
    "drift": ("slow targets over the better of `position` and Kalman", _ratios, ""),
    "sharp": (
        "fictitious target, as the turtlebot sees it, mrad",
        _largest("turtlebot sees it, 0 ms"),
        "21",
    ),
    "ordinary": ("NEES: lowest and highest path", _nees, "0.5 to 2"),
}
