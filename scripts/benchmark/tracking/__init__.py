"""Judges tracking in simulated time, in full windows, against simple laws.

    scripts/benchmark/measure tracking --only mixed --seeds 100..115

Points go to the tracker as on a robot: cameras move with the head and see 60 x 45 degrees; what a
head loses, it does not see.
"""

import argparse
import statistics
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path as File

from closed_loop import ClosedLoop

from head_tracking.tracking import picture
from tracking.asked import asked, cases, simple
from tracking.judging import OPPONENTS, Job, Score, judge_all, tracker
from tracking.situations import FAMILIES, SITUATIONS

DOCS = File(__file__).parents[3] / "docs" / "pictures"
SEEDS = {"mixed": 16, "near": 18, "turns": 8, "servos": 400, "table": 1, "ordinary": 20}
"""How many seeds a family has by default; others: 5."""


def main(arguments: Sequence[str] = ()) -> str:
    """Judge what is asked for, and return the tables."""
    parser = argparse.ArgumentParser(prog="scripts/benchmark/measure tracking")
    parser.add_argument("--only", default=",".join(FAMILIES), help="families (default: all)")
    parser.add_argument("--seeds", default="", help="FIRST..LAST")
    parser.add_argument("--exam", action="store_true", help="draw from wider ranges")
    parser.add_argument("--asked", action="store_true", help="only what is asked of each family")
    options = parser.parse_args(arguments)
    scores = judge_all(
        Job(situation.name, seed, name, options.exam)
        for situation in SITUATIONS.values()
        if situation.family in options.only.split(",")
        for seed in seeds(options.seeds, situation.family)
        for name in ("ours", *OPPONENTS)
    )
    chosen: dict[str, dict[Job, Score]] = {}
    for job, score in scores.items():
        chosen.setdefault(SITUATIONS[job.situation].family, {})[job] = score
    parts = [asked(chosen)]
    if not options.asked:
        parts += [cases(part) if family == "table" else table(family, part)
                  for family, part in chosen.items()]  # fmt: skip
    return "\n\n".join(parts)


def seeds(text: str, family: str) -> range:
    """Return the seeds that are meant."""
    if text:
        first, _, last = text.partition("..")
        return range(int(first), int(last or first) + 1)
    return range(100, 100 + SEEDS.get(family, 5))


def table(family: str, scores: dict[Job, Score]) -> str:
    """Return a row for each situation: errors in mrad, medians of all seeds."""
    titles = [
        f"{family}: rms, mrad", "ours", "worst seed", *OPPONENTS,
        "over the better simple law: median", "worst", "largest error", "overshoot",
        "oscillating", "blind", "NEES",
    ]  # fmt: skip
    rows = [f"| {' | '.join(titles)} |", "|---" * len(titles) + "|"]
    for name in dict.fromkeys(job.situation for job in scores):
        here = {job: score for job, score in scores.items() if job.situation == name}
        ours = {job: score for job, score in here.items() if job.who == "ours"}
        found = list(ours.values())
        ratios = [score.rms / simple(scores, job) for job, score in ours.items()]
        cells = [
            f"{median(found):.1f}",
            f"{max(score.rms for score in found):.1f}",
            *(f"{median([s for job, s in here.items() if job.who == o]):.0f}" for o in OPPONENTS),
            f"{statistics.median(ratios):.2f}",
            f"{max(ratios):.2f}",
            f"{max(score.worst for score in found):.0f}",
            f"{max(score.overshoot for score in found):.0f}",
            f"{100.0 * statistics.fmean(score.oscillating for score in found):.0f} %",
            f"{100.0 * statistics.fmean(score.blind for score in found):.0f} %",
            f"{statistics.median(score.nees for score in found):.2f}",
        ]
        rows.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(rows)


def median(scores: Sequence[Score]) -> float:
    """Return the median error [mrad]."""
    return statistics.median(score.rms for score in scores)


def tracking() -> str:
    """Judge everything, draw two laws on one target, and return the tables."""
    swing = SITUATIONS["±0.5 rad, 0.5 Hz"].setup(1, False)
    for name, law, rate in (("speed", "speed", 10.0), ("predictive", "predictive", 50.0)):
        conditions = replace(swing.conditions, rate=rate)
        loop = ClosedLoop(swing.path, conditions)
        trace = loop.run(tracker(law, loop, conditions)).recording
        title = f"law {name}: ±0.5 rad at 0.5 Hz, 2 mrad noise, 100 ms late"
        (DOCS / f"tracking_{name}.svg").write_text(picture(trace, title))
    return main()
