"""docs/reference and the tree in docs/explain/architecture.md say what the code says."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def test_generated_documents_are_up_to_date():
    for package in ("control_msgs", "tf2_msgs", "vision_msgs"):
        pytest.importorskip(f"{package}.msg")
    command = [sys.executable, str(ROOT / "scripts" / "reference.py"), "--check"]
    answer = subprocess.run(command, check=False, capture_output=True, text=True, timeout=120)
    assert answer.returncode == 0, f"{answer.stdout}{answer.stderr}\nrun scripts/reference"


def test_the_tree_separates_each_file_from_its_description():
    assert not re.search(r"\.py\w", (ROOT / "docs/explain/architecture.md").read_text())
