"""Judges tracking in simulated time, in full windows, against simple laws.

    scripts/benchmark/measure tracking --only mixed --seeds 100..115

Points go to the tracker as on a robot: cameras move with the head and see 60 x 45 degrees; what a
head loses, it does not see.
"""

from __future__ import annotations

import argparse
import json
import statistics
from collections.abc import Sequence
from pathlib import Path as File

import numpy as np

from tracking.asked import asked, cases, simple
from tracking.judging import HEAD, OPPONENTS, Job, Score, judge, judge_all
from tracking.motions import PATHS
from tracking.situations import FAMILIES, SITUATIONS

SEEDS = {"mixed": 16, "near": 18, "turns": 8, "servos": 400, "table": 1, "ordinary": 20}
"""How many seeds a family has by default; others: 5."""


def main(arguments: Sequence[str]) -> str:
    """Judge what is asked for and return the table."""
    parser = argparse.ArgumentParser(prog="scripts/benchmark/measure tracking")
    parser.add_argument("--only", default="mixed", help=f"families: {', '.join(FAMILIES)}")
    parser.add_argument("--named", default="", help="only situations with this in their name")
    parser.add_argument("--seeds", default="", help="FIRST..LAST")
    parser.add_argument("--who", default=f"ours,{','.join(OPPONENTS)}")
    parser.add_argument("--processes", type=int)
    parser.add_argument("--exam", action="store_true", help="wider ranges")
    parser.add_argument("--asked", action="store_true", help="only what is asked of each family")
    parser.add_argument("--json", type=File, help="write all scores into this file")
    options = parser.parse_args(arguments)
    chosen = [
        situation
        for situation in SITUATIONS.values()
        if situation.family in options.only.split(",") and options.named in situation.name
    ]
    who = options.who.split(",")
    jobs = [
        Job(situation.name, seed, name, options.exam)
        for situation in chosen
        for seed in seeds(options.seeds, situation.family)
        for name in who
    ]
    scores = judge_all(jobs, options.processes)
    if options.asked:
        return asked(scores)
    if options.json:
        options.json.write_text(json.dumps([[vars(job), score] for job, score in scores.items()]))
    if options.only == "table":
        return cases(scores)
    return "\n".join(table(scores, who))


def seeds(text: str, family: str) -> range:
    """Return the seeds that are meant."""
    if text:
        first, _, last = text.partition("..")
        return range(int(first), int(last or first) + 1)
    return range(100, 100 + SEEDS.get(family, 5))


def table(scores: dict[Job, Score], who: Sequence[str]) -> list[str]:
    """Return a row for each situation and controller."""
    titles = (
        "Situation", "Controller", "rms: median, mrad", "worst seed", "largest error",
        "over the better simple law: median", "worst", "oscillating", "overshoot, mrad", "blind",
        "NEES",
    )  # fmt: skip
    rows = [f"| {' | '.join(titles)} |", "|---" * len(titles) + "|"]
    for name in dict.fromkeys(job.situation for job in scores):
        for each in who:
            found = {
                job: score
                for job, score in scores.items()
                if (job.situation, job.who) == (name, each)
            }
            ratios = [score.rms / simple(scores, job) for job, score in found.items()]
            values = list(found.values())
            errors = [score.rms for score in values]
            rows.append(
                f"| {name} | {each} | {statistics.median(errors):.1f} | {max(errors):.1f} | "
                f"{max(score.worst for score in values):.0f} | {statistics.median(ratios):.2f} | "
                f"{max(ratios):.2f} | "
                f"{100.0 * statistics.fmean(score.oscillating for score in values):.1f} % | "
                f"{max(score.overshoot for score in values):.0f} | "
                f"{100.0 * statistics.fmean(score.blind for score in values):.1f} % | "
                f"{float(np.median([score.nees for score in values])):.2f} |"
            )
    return rows


def tracking() -> str:
    """Return the tables of the results document."""
    return main(["--only", "mixed"])


__all__ = [
    "HEAD",
    "OPPONENTS",
    "PATHS",
    "SITUATIONS",
    "Job",
    "Score",
    "judge",
    "judge_all",
    "tracking",
]
