"""STOP by a key, in a terminal with a shell as a person has it."""

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
from head_tracking.run.stop_key import RESUME, STOP, StopKey, carry_out, meaning

PROGRAM = Path(__file__).parent / "support" / "stop_key_program.py"


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    terminal = Terminal()
    yield terminal
    terminal.close()


@pytest.mark.parametrize("key", [" ", "s"])
def test_a_key_stops_and_r_resumes_and_nothing_else_does(terminal, key):
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


def test_a_key_that_was_pressed_while_the_program_started_stops(terminal):
    terminal.start(f"{PROGRAM} wait")
    terminal.type(" ")
    terminal.waits_for("<STOP: pan relaxed")
    terminal.type("\x03")
    terminal.waits_for(r"\$ ")


@pytest.mark.parametrize("way", ["error", "exit"])
def test_the_terminal_is_as_before_however_the_program_ends(terminal, way):
    terminal.start(f"{PROGRAM} {way}")
    terminal.waits_for("<keys work: True>")
    terminal.waits_for(r"\$ ")
    assert terminal.is_as_before()


@pytest.mark.parametrize("number", [*ENDING, signal.SIGKILL])
def test_the_terminal_is_as_before_after_a_signal(terminal, number):
    terminal.start(f"{PROGRAM} wait")
    pid = re.search(r"process (\d+)", terminal.waits_for("<keys work: True>"))
    assert pid is not None
    os.kill(int(pid[1]), number)
    terminal.waits_for(r"\$ ")
    assert terminal.is_as_before()


def test_a_suspended_program_leaves_the_terminal_and_takes_it_again(terminal):
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


def test_in_the_background_the_terminal_is_the_shells(terminal):
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
def test_a_stop_is_heard_among_other_keys(keys):
    assert meaning(keys) == STOP


def test_keys_of_a_sequence_mean_nothing():
    assert meaning(b"\x1b[s\x1bOr") == ""
    assert meaning(b"\x1b[sr") == RESUME


def test_without_a_terminal_nothing_is_read():
    key = StopKey(io.StringIO("s"))
    assert not key.has_terminal
    key.acquire()
    assert not key.works
    key.release()


def test_a_stop_that_fails_says_that_nothing_is_confirmed():
    def fail() -> list[str]:
        raise RuntimeError("no bus")

    shown = carry_out(STOP, fail, lambda: [])
    assert "RuntimeError: no bus" in shown
    assert "NOT confirmed" in shown
