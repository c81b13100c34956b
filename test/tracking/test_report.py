import math
from xml.etree import ElementTree

import pytest

from head_tracking.tracking import Sample, Trace, lag, picture, table

DT = 0.02


def swing(behind=0.1, seconds=8.0):
    recording = Trace()
    for k in range(int(seconds / DT)):
        t = k * DT
        wanted, pan = math.sin(2.0 * t), math.sin(2.0 * (t - behind))
        recording.add(Sample(t, (wanted, 0.1), (pan, 0.1), abs(wanted - pan)))
    return recording


@pytest.mark.parametrize("behind", [-0.05, 0.0, 0.1, 0.3])
def test_how_far_the_head_is_behind(behind):
    assert lag(swing(behind)) == pytest.approx(behind, abs=0.006)


def test_the_table_has_the_figures():
    text = table(swing(), [0.04, 0.06], 29.97, markdown=True)
    assert "| target | 30.0 points/s, 50 ms old |" in text
    assert f"{1e3 * swing().rms:.1f} mrad" in text
    assert "| head behind its target | 100 ms |" in text
    assert "2.00 rad/s for a target at 2.00" in text


def test_the_picture_is_svg_with_all_curves():
    root = ElementTree.fromstring(picture(swing(), "head & target"))
    names = [element.tag.split("}")[1] for element in root]
    assert names.count("polyline") == 9
    text = " ".join(element.text or "" for element in root.iter())
    for word in ("head & target", "pan, °", "error, °", "tilt, rad/s"):
        assert word in text
