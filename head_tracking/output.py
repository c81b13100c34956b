"""Standard output and error whose failures do not stop the program."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TextIO


@contextmanager
def tolerate_output_errors() -> Iterator[None]:
    """Discard output that cannot be written, until the end of the block.

    A closed pipe (`| head -1`) and a full disk raise no error. Characters that the encoding of the
    terminal lacks become question marks.
    """
    sys.stdout, sys.stderr = _tolerant(sys.stdout), _tolerant(sys.stderr)
    try:
        yield
    finally:
        for stream in (sys.stdout, sys.stderr):
            _discard_unwritten(stream)


class _TolerantStream(io.TextIOWrapper):
    def write(self, text: str, /) -> int:
        try:
            return super().write(text)
        except OSError:
            return len(text)

    def flush(self) -> None:
        with suppress(OSError):
            super().flush()


def _tolerant(stream: TextIO | None) -> TextIO:
    if not isinstance(stream, io.TextIOWrapper):  # closed, or replaced
        return stream or open(os.devnull, "w")
    encoding, by_line, through = stream.encoding, stream.line_buffering, stream.write_through
    return _TolerantStream(
        stream.detach(),
        encoding,
        "replace",
        line_buffering=by_line,
        write_through=through,
    )


def _discard_unwritten(stream: TextIO) -> None:
    """Redirect a stream that cannot be flushed, or Python would exit with an error."""
    if isinstance(stream, _TolerantStream):
        try:
            stream.buffer.flush()
        except OSError:
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, stream.fileno())
            os.close(null)
