"""Standard output and error that may get lost without anybody minding: the robot goes on."""

from __future__ import annotations

import codecs
import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TextIO

_IN_ASCII = {"°": "deg", "±": "+-", "→": "->", "µ": "u"}


@contextmanager
def output_may_get_lost() -> Iterator[None]:
    """Until the end of the block whatever cannot be written is dropped.

    A reader that has gone (`| head -1`) and a full disk raise no error, and signs that a terminal
    does not have are written in ASCII.
    """
    codecs.register_error("in_ascii", _in_ascii)
    sys.stdout, sys.stderr = _forgiving(sys.stdout), _forgiving(sys.stderr)
    try:
        yield
    finally:
        for stream in (sys.stdout, sys.stderr):
            _let_go(stream)


class _ForgivingStream(io.TextIOWrapper):
    def write(self, text: str, /) -> int:
        try:
            return super().write(text)
        except OSError:
            return len(text)

    def flush(self) -> None:
        with suppress(OSError):
            super().flush()


def _forgiving(stream: TextIO | None) -> TextIO:
    if not isinstance(stream, io.TextIOWrapper):  # closed, or somebody's own
        return stream or open(os.devnull, "w")
    encoding, by_line, through = stream.encoding, stream.line_buffering, stream.write_through
    return _ForgivingStream(
        stream.detach(), encoding, "in_ascii", line_buffering=by_line, write_through=through
    )


def _let_go(stream: TextIO) -> None:
    """What could not be written keeps Python from ending well."""
    if isinstance(stream, _ForgivingStream):
        try:
            stream.buffer.flush()
        except OSError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)


def _in_ascii(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    signs = error.object[error.start : error.end]
    return "".join(_IN_ASCII.get(sign, "?") for sign in signs), error.end
