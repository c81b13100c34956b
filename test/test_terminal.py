"""The terminal of a run: its STOP key and its status line."""

import fcntl
import io
import os
import struct
import sys
import termios
from types import SimpleNamespace

import pytest

from head_tracking.cli.terminal import Terminal
from head_tracking.run.control import ControlProcess
from head_tracking.run.status_line import StatusLine
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
    def fail():
        raise RuntimeError("no bus")

    stream = io.StringIO()
    link = SimpleNamespace(send=lambda **message: None)
    process = ControlProcess(SimpleNamespace(nodes=()), None, link, StatusLine(stream))
    process._head = SimpleNamespace(loop=SimpleNamespace(stop=fail))
    process._press(STOP)
    shown = stream.getvalue()
    assert "RuntimeError: no bus" in shown
    assert "NOT confirmed" in shown


PARTS = ("error  0.6°", "pan  +33.4° tilt   -2.6°", "target (0.75, 0.5, 0.4) in a", "bus 50 Hz")


def on_terminal(columns, *shown):
    """Return what is written on a terminal of a width, between the codes that clear the line."""
    master, slave = os.openpty()
    fcntl.ioctl(master, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    with os.fdopen(slave, "w") as stream:
        line = StatusLine(stream)
        line.prepare_logging()
        for parts in shown:
            line.show(parts)
        line.end("done")
        text = b""
        while b"done\r\n" not in text:  # a read may return a part
            text += os.read(master, 1000)
    os.close(master)
    return text.decode().split("\r\x1b[K")


def test_without_a_terminal_it_prints_at_most_one_line_a_second():
    stream = io.StringIO()
    line = StatusLine(stream)
    for number in range(100):
        line.show([f"text {number}", "more"])
    line.end("done")
    lines = stream.getvalue().splitlines()
    assert lines[0] == "text 0 | more"
    assert lines[-1] == "done"
    assert len(lines) < 50


@pytest.mark.parametrize(
    ("columns", "shown"),
    [(0, (0, 1, 2, 3)), (60, (0, 1, 3)), (30, (0, 3))],
)
def test_on_a_terminal_the_line_is_overwritten_and_parts_that_do_not_fit_are_left_out(
    monkeypatch, columns, shown
):
    monkeypatch.setenv("RCUTILS_CONSOLE_OUTPUT_FORMAT", "")
    monkeypatch.delenv("RCUTILS_CONSOLE_OUTPUT_FORMAT")
    monkeypatch.setenv("TERM", "xterm")
    text = " | ".join(PARTS[index] for index in shown)
    assert on_terminal(columns, ["first"], PARTS) == ["", "first", text, "done\r\n"]
    assert os.environ["RCUTILS_CONSOLE_OUTPUT_FORMAT"].startswith("\r\x1b[K[{severity}]")


def test_a_terminal_that_cannot_clear_a_line_gets_new_lines(monkeypatch, capsys):
    monkeypatch.setenv("TERM", "dumb")
    assert on_terminal(80, ["first"], PARTS) == ["first\r\ndone\r\n"]
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    with Terminal().screen() as show:
        show("one")
        show("two")
    assert capsys.readouterr().out == "one\ntwo\n"
