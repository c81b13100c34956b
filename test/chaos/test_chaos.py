"""A head that is struck by whatever can happen: see test/support/chaos.py.

`scripts/benchmark/measure chaos --minutes M --seed N` strikes for longer.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).parents[1] / "support" / "chaos.py"


@pytest.mark.parametrize(
    ("seed", "layout"),
    [(1, ["--run", "composed"]), (2, ["--run", "nodes", "--clock"])],
    ids=["composed", "nodes"],
)
def test_nothing_moves_by_itself_stop_works_and_the_head_recovers(seed, layout):
    done = subprocess.run(
        [sys.executable, PROGRAM, "--seed", str(seed), "--seconds", "8", *layout],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["recoveries"] > 0
    assert sum(told["struck"].values()) > 0
