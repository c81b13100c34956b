import subprocess
import sys

import pytest
from waiting import PATIENCE

from head_tracking.cli.check_model import main

KINECTBOT = """\
robot name is: kinectbot
---------- Successfully Parsed XML ---------------
root Link: base_link has 1 child(ren)
    child(1):  torso_link
        child(1):  head_pan_link
            child(1):  pan_tilt_bracket
                child(1):  head_tilt_link
                    child(1):  neck_link
"""


def test_the_tree_has_the_format_of_check_urdf(capsys):
    assert main(["kinectbot"]) == 0
    *tree, last = capsys.readouterr().out.splitlines(keepends=True)
    assert "".join(tree).startswith(KINECTBOT)
    assert "                                    child(2):  left_eye_link\n" in tree
    assert last.startswith("14 links, 13 joints: 2 move")


@pytest.mark.parametrize(
    "text", ['<robot name="r"><link name="a"/><link name="a"/></robot>', "<robot>"]
)
def test_a_bad_model_is_reported_with_its_file(tmp_path, capsys, text):
    model = tmp_path / "bad.urdf"
    model.write_text(text)
    assert main([str(model)]) == 1
    assert "bad.urdf" in capsys.readouterr().err


def test_output_that_cannot_be_written_is_an_error():
    command = [sys.executable, "-m", "head_tracking", "check_model", "kinectbot"]
    with open("/dev/full", "w") as full:
        assert subprocess.run(command, stdout=full, timeout=PATIENCE, check=False).returncode == 1
