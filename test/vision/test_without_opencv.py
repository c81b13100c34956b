"""OpenCV is optional: everything loads without it, and what needs it says how to get it."""

import subprocess
import sys

import pytest

WITHOUT = "import sys\nsys.modules['cv2'] = None\n"


@pytest.fixture(scope="module")
def opencv():
    """Not needed here."""


def run(code):
    return subprocess.run(
        [sys.executable, "-c", WITHOUT + code],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


def test_everything_loads_without_it():
    done = run("import head_tracking.vision, head_tracking.scene, head_tracking.run.node_sets")
    assert done.returncode == 0, done.stderr


def test_a_program_that_needs_it_says_how_to_get_it():
    done = run(
        "import sys; sys.argv = ['visual_target']\n"
        "from head_tracking.programs import visual_target as main; sys.exit(main())"
    )
    assert done.returncode == 1
    assert "OpenCV is not installed" in done.stderr
    assert "requirements/vision.txt" in done.stderr
    assert "Traceback" not in done.stderr


def test_it_is_not_loaded_before_it_is_used():
    code = "import sys, head_tracking.run.node_sets; sys.exit('cv2' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], check=False, timeout=120)
    assert done.returncode == 0
