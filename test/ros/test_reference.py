"""docs/reference and the tree in docs/explain/architecture.md say what the code says."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def test_generated_documents_are_up_to_date() -> None:
    for package in ("control_msgs", "tf2_msgs", "vision_msgs"):
        pytest.importorskip(f"{package}.msg")
    command = [sys.executable, str(ROOT / "scripts" / "reference.py"), "--check"]
    answer = subprocess.run(command, check=False, capture_output=True, text=True, timeout=120)
    assert answer.returncode == 0, f"{answer.stdout}{answer.stderr}\nrun scripts/reference"
