"""The line at the bottom of a run's terminal."""

import fcntl
import io
import os
import pty
import struct
import termios
from collections.abc import Iterator

import pytest

from head_tracking.run.status_line import StatusLine

PARTS = ("error  0.6°", "pan  +33.4° tilt   -2.6°", "target (0.75, 0.5, 0.4) in a", "bus 50 Hz")


class Terminal:
    """A pseudo-terminal with a width."""

    def __init__(self) -> None:
        self._master, slave = pty.openpty()
        self.stream = os.fdopen(slave, "w")

    def set_width(self, columns: int) -> None:
        fcntl.ioctl(self._master, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))

    def written(self, last: str) -> str:
        text = b""
        while last.encode() not in text:  # a read may return a part
            text += os.read(self._master, 1000)
        return text.decode()

    def close(self) -> None:
        self.stream.close()
        os.close(self._master)


@pytest.fixture
def terminal(monkeypatch) -> Iterator[Terminal]:
    monkeypatch.setenv("RCUTILS_CONSOLE_OUTPUT_FORMAT", "")
    monkeypatch.delenv("RCUTILS_CONSOLE_OUTPUT_FORMAT")
    terminal = Terminal()
    yield terminal
    terminal.close()


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


def test_on_a_terminal_the_line_is_overwritten(terminal):
    line = StatusLine(terminal.stream)
    line.prepare_logging()
    line.show(["first"])
    line.show(["second"])
    line.end("done")
    written = terminal.written("done\r\n")
    assert written.split("\r\x1b[K") == ["", "first", "second", "done\r\n"]
    assert os.environ["RCUTILS_CONSOLE_OUTPUT_FORMAT"].startswith("\r\x1b[K[{severity}]")


@pytest.mark.parametrize(
    ("columns", "shown"),
    [(0, (0, 1, 2, 3)), (60, (0, 1, 3)), (30, (0, 3))],
)
def test_parts_that_do_not_fit_are_left_out(terminal, columns, shown):
    terminal.set_width(columns)
    line = StatusLine(terminal.stream)
    line.show(PARTS)
    line.end("done")
    text = " | ".join(PARTS[index] for index in shown)
    assert terminal.written("done\r\n").split("\r\x1b[K")[1] == text
