"""STOP by a key, in a terminal with a shell."""

import io

import pytest

from head_tracking.run.control import execute
from head_tracking.run.stop_key import RESUME, STOP, StopKey, meaning


@pytest.mark.parametrize("keys", [b"\x1b[A ", b"rrs", b"s" * 64, b"\x1b s"])
def test_stop_has_priority_over_other_keys(keys):
    assert meaning(keys) == STOP


def test_escape_sequences_are_ignored():
    assert meaning(b"\x1b[s\x1bOr") == ""
    assert meaning(b"\x1b[sr") == RESUME


def test_without_a_terminal_no_keys_are_read():
    key = StopKey(io.StringIO("s"))
    key.acquire()
    assert not key.works
    key.release()


def test_a_failed_stop_is_not_confirmed():
    def fail() -> dict[str, str]:
        raise RuntimeError("no bus")

    shown = execute(STOP, fail, tuple)
    assert "RuntimeError: no bus" in shown
    assert "NOT confirmed" in shown
