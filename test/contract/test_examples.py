"""Every example, run in simulation as its first lines say."""

import math
import re
import signal
from pathlib import Path

import pytest
from rig import SOURCE, run_python
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

EXAMPLES = SOURCE / "examples"


def run(name, *words, text=""):
    done = run_python(str(EXAMPLES / name), *words, text=text)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_example_is_short_is_in_the_documents_and_has_a_test_here():
    tests = Path(__file__).read_text()
    page = (SOURCE / "docs/start/without_ros.md").read_text()
    for example in EXAMPLES.glob("*.py"):
        assert len(example.read_text().splitlines()) <= 40, example
        assert f'"{example.name}"' in tests, example
        assert f"(../../examples/{example.name})" in page, example


def test_look_around():
    lines = run("look_around.py").splitlines()
    assert [("arrived" in line, "out of reach" in line) for line in lines] == [
        (True, False), (True, False), (True, False), (False, True),
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["follow_target.py", "own_detector.py", "follow_face.py"])
def test_following(name):
    # coasting: on a busy computer a point may be overdue
    lines = run(name, "--sim").splitlines()
    *_, last = (line for line in lines if not line.startswith("coasting"))
    assert last.startswith("tracking")
    assert float(re.search(r"([\d.]+) degrees", last)[1]) < 8.0


def test_two_heads():
    assert run("two_heads.py", "--sim", "--sim").count("arrived") == 2


def test_keyboard():
    lines = run("keyboard.py", "--sim", text="aa\n d\nrd\n").splitlines()
    pans = [float(line.split()[1]) for line in lines if line.startswith("pan")]
    assert pans[:2] == pytest.approx([0.2, 0.4], abs=0.03)
    assert pans[2:5] == pytest.approx([0.4] * 3, abs=0.06)  # stopped, refused, resumed
    assert pans[5] == pytest.approx(0.2, abs=0.06)


def test_record_and_plot(tmp_path):
    picture = tmp_path / "turn.svg"
    run("record_and_plot.py", "--sim", str(picture))
    assert picture.read_text().count("<polyline") == 2


def test_other_servos():
    lines = run("other_servos.py", "--sim").splitlines()
    assert lines[0].startswith("arrived")
    assert [line.count("XL430-W250") for line in lines[1:]] == [1, 1]


def test_ros_node(bench):
    node = bench.start(str(EXAMPLES / "ros_node.py"), "--sim")
    errors = bench.person.hear("tracking_error", Float64)
    bench.person.keep_looking(2, 0.5, 0.6, lambda: errors and errors[-1].data < 0.03)
    assert node.end(signal.SIGINT) == 0, node.output


def test_own_driver(bench):
    pytest.importorskip("trajectory_msgs")
    driver = EXAMPLES / "own_driver.py"
    for command in re.findall(r"^ros2 run head_tracking (.*)", driver.read_text(), re.MULTILINE):
        bench.start(*command.split())
    node = bench.start(str(driver))
    states = bench.person.hear("joint_states", JointState)
    bench.person.keep_looking(
        2, 1, 0.5, lambda: states and abs(states[-1].position[0] - math.atan2(1, 2)) < 0.02
    )
    assert node.end(signal.SIGINT) == 0, node.output
