import io
import os
import pty

from head_tracking.status_line import StatusLine


def test_without_a_terminal_each_text_is_a_line_but_not_more_than_one_a_second():
    stream = io.StringIO()
    line = StatusLine(stream)
    for number in range(100):
        line.show(f"text {number}")
    line.end("done")
    lines = stream.getvalue().splitlines()
    assert lines[0] == "text 0"
    assert lines[-1] == "done"
    assert len(lines) < 50


def test_on_a_terminal_the_line_is_written_over(monkeypatch):
    monkeypatch.setenv("RCUTILS_CONSOLE_OUTPUT_FORMAT", "")
    monkeypatch.delenv("RCUTILS_CONSOLE_OUTPUT_FORMAT")
    master, slave = pty.openpty()
    with os.fdopen(slave, "w") as stream:
        line = StatusLine(stream)
        line.prepare_logging()
        line.show("first")
        line.show("second")
        line.end("done")
        written = ""
        while "done" not in written:  # a terminal gives what it has, not what was written
            written += os.read(master, 1000).decode()
    os.close(master)
    assert written.split("\r\x1b[K") == ["", "first", "second", "done\r\n"]
    assert os.environ["RCUTILS_CONSOLE_OUTPUT_FORMAT"].startswith("\r\x1b[K[{severity}]")


def test_nothing_is_shown_after_the_end():
    stream = io.StringIO()
    line = StatusLine(stream)
    line.end("done")
    line.show("late")
    assert stream.getvalue() == "done\n"
