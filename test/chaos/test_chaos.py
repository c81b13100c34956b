"""Random faults in a running head: test/support/chaos.py, which runs longer by `--seconds`."""

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
def test_only_commands_move_the_head_and_it_stops_and_recovers(seed, layout):
    done = subprocess.run(
        [sys.executable, PROGRAM, "--seed", str(seed), "--seconds", "5", *layout],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["recoveries"] > 0
    assert sum(result["faults"].values()) > 0
