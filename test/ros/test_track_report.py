"""track_report on a simulated head."""

import argparse

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor

from head_tracking.tools import track_report
from head_tracking.tools.track_report import TrackReportNode, record_run


@pytest.fixture
def report(capsys, tmp_path, monkeypatch):
    """Runs the report for a while; gives exit code, output and picture."""
    monkeypatch.setattr(track_report, "_PATIENCE", 5.0)

    def run(duration):
        picture = tmp_path / "picture.svg"
        node, executor = TrackReportNode(), SingleThreadedExecutor()
        executor.add_node(node)
        options = argparse.Namespace(duration=duration, output=picture, markdown=False)
        try:
            code = record_run(node, executor, options, lambda: False)
        finally:
            executor.shutdown()
            node.destroy_node()
        return code, capsys.readouterr(), picture

    return run


def test_a_run_becomes_a_table_and_a_picture(make_robot, report):
    make_robot("--target", "fictitious")
    code, output, picture = report(6.0)
    assert code == 0, output.err
    assert "error, rms  " in output.out
    assert "|" not in output.out
    assert "recording: " in output.err
    assert "points/s" in output.out
    assert picture.read_text().startswith("<svg")


def test_without_a_target_it_says_so(make_robot, report):
    make_robot("--target", "none")
    code, output, picture = report(1.0)
    assert code == 1
    assert "target_point" in output.err
    assert not picture.exists()


def test_without_a_head_it_says_so(report, monkeypatch):
    monkeypatch.setattr(track_report, "_PATIENCE", 0.2)
    rclpy.init()
    try:
        code, output, _ = report(1.0)
    finally:
        rclpy.shutdown()
    assert code == 1
    assert "is a head running" in output.err


def test_durations_are_checked(capsys):
    for bad in ("0", "-1", "nan", "soon"):
        with pytest.raises(SystemExit):
            track_report._parse(["--duration", bad])
        assert "seconds above 0" in capsys.readouterr().err
    assert track_report._parse([]).duration == 20.0


def test_where_the_picture_goes_is_checked_before_anything_is_recorded(capsys, tmp_path):
    with pytest.raises(SystemExit):
        track_report._parse(["--output", str(tmp_path / "nowhere" / "picture.svg")])
    assert "cannot be written (No such file or directory)" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        track_report._parse(["--output", str(tmp_path)])
    assert "cannot be written" in capsys.readouterr().err
    good, there = tmp_path / "picture.svg", tmp_path / "old.svg"
    there.write_text("old")
    assert track_report._parse(["--output", str(good)]).output == good
    assert track_report._parse(["--output", str(there)]).output == there
    assert not good.exists()
    assert there.read_text() == "old"
