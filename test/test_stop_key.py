"""STOP by a key, in a terminal with a shell."""

import io
import os
import re
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from terminal import Terminal
from waiting import eventually

from head_tracking.ros.kit.stop_signal import ENDING
from head_tracking.run.stop_key import RESUME, STOP, StopKey, execute, meaning

PROGRAM = Path(__file__).parent / "support" / "stop_key_program.py"


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    terminal = Terminal()
    yield terminal
    terminal.close()


@pytest.mark.parametrize("key", [" ", "s"])
def test_space_and_s_stop_and_r_resumes(terminal, key):
    terminal.start(f"{PROGRAM} wait")
    terminal.waits_for("<keys work: True>")
    terminal.type("x\x1b[A\x1b[15~\x1bOSq1\n\x1b")
    terminal.type(key)
    assert "resumed" not in terminal.waits_for("<STOP: pan relaxed; r resumes>")
    terminal.type("q")
    terminal.type("r")
    assert "STOP" not in terminal.waits_for("<resumed: slowly>")
    terminal.type("\x03")
    terminal.waits_for(r"\$ ")
    assert terminal.is_as_before()


def test_a_key_pressed_during_the_start_stops(terminal):
    terminal.start(f"{PROGRAM} wait")
    terminal.type(" ")
    terminal.waits_for("<STOP: pan relaxed")
    terminal.type("\x03")
    terminal.waits_for(r"\$ ")


@pytest.mark.parametrize("way", ["error", "exit"])
def test_the_terminal_is_restored_after_an_error_and_an_exit(terminal, way):
    terminal.start(f"{PROGRAM} {way}")
    terminal.waits_for("<keys work: True>")
    terminal.waits_for(r"\$ ")
    assert terminal.is_as_before()


@pytest.mark.parametrize("number", [*ENDING, signal.SIGKILL])
def test_the_terminal_is_restored_after_a_signal(terminal, number):
    terminal.start(f"{PROGRAM} wait")
    pid = re.search(r"process (\d+)", terminal.waits_for("<keys work: True>"))
    assert pid is not None
    os.kill(int(pid[1]), number)
    terminal.waits_for(r"\$ ")
    assert terminal.is_as_before()


def test_a_suspended_program_restores_the_terminal_and_continues_later(terminal):
    terminal.start(f"{PROGRAM} wait")
    terminal.waits_for("<keys work: True>")
    terminal.type("\x1a")
    terminal.waits_for("Stopped")
    assert terminal.is_as_before()
    terminal.type("fg\n")
    terminal.waits_for("stop_key_program")
    assert eventually(lambda: stops(terminal))
    terminal.type("\x03")
    terminal.waits_for(r"\$ ")
    assert terminal.is_as_before()


def stops(terminal: Terminal) -> bool:
    terminal.type("s")
    return "<STOP: pan relaxed" in terminal.shown


def test_in_the_background_no_keys_are_read(terminal):
    terminal.start(f"{PROGRAM} wait &")
    terminal.waits_for("<keys work: False>")
    assert terminal.is_as_before()
    terminal.type("echo sss\n")
    terminal.waits_for("\r\nsss\r")
    assert "STOP" not in terminal.shown
    terminal.type("fg\n")
    assert eventually(lambda: stops(terminal))
    terminal.type("\x03")


@pytest.mark.parametrize("keys", [b"\x1b[A ", b"rrs", b"s" * 64, b"\x1b s"])
def test_stop_has_priority_over_other_keys(keys):
    assert meaning(keys) == STOP


def test_escape_sequences_are_ignored():
    assert meaning(b"\x1b[s\x1bOr") == ""
    assert meaning(b"\x1b[sr") == RESUME


def test_without_a_terminal_no_keys_are_read():
    key = StopKey(io.StringIO("s"))
    assert not key.has_terminal
    key.acquire()
    assert not key.works
    key.release()


def test_a_failed_stop_is_not_confirmed():
    def fail() -> list[str]:
        raise RuntimeError("no bus")

    shown = execute(STOP, fail, lambda: [])
    assert "RuntimeError: no bus" in shown
    assert "NOT confirmed" in shown
