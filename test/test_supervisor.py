"""Which nodes the supervisor starts again after their process has ended."""

import time
from types import SimpleNamespace

import pytest

from head_tracking.run.supervisor import RestartedProcess


@pytest.fixture
def vision(monkeypatch: pytest.MonkeyPatch) -> RestartedProcess:
    """A process that always ends with 1."""
    process = SimpleNamespace(
        started=time.monotonic(), wait=lambda: 1, channel=SimpleNamespace(send=lambda node: None)
    )
    monkeypatch.setattr("head_tracking.run.supervisor.Process", lambda *_: process)
    return RestartedProcess("vision", [], ())


def test_a_node_requested_while_its_process_ends_is_started_in_the_next(vision):
    for _ in range(2):  # each time another node was the reason for the end
        vision.add({"name": "visual_target"})
        vision.start()
        vision.on_report({"node": "visual_target", "problem": "too far", "enabled": True})
        vision.add({"name": "simulated_camera"})
        assert vision.on_end() == []
        assert vision.start_at is not None
        assert list(vision.nodes) == ["simulated_camera"]
    vision.start()
    (failed,) = vision.on_end()  # now itself
    assert failed["node"] == "simulated_camera"
    assert vision.start_at is None
