"""Standard output and error whose failures do not stop the program."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable
from typing import TextIO


def tolerate_output_errors() -> None:
    """Discard output that cannot be written, from now on; see `check_output`.

    A closed pipe (`| head -1`) and a full disk raise no error. Characters that the encoding of the
    terminal lacks become question marks.
    """
    sys.stdout, sys.stderr = _tolerant(sys.stdout), _tolerant(sys.stderr)


def is_output_closed() -> bool:
    """Return whether the reader of standard output has ended, as in `| head -1`."""
    return getattr(sys.stdout, "is_closed_by_reader", False)


def check_output() -> None:
    """Raise the OSError for which standard output is incomplete, such as a full disk."""
    sys.stdout.flush()
    failure = getattr(sys.stdout, "failure", None)
    if failure is not None:
        raise OSError(failure.errno, failure.strerror, "standard output")


class _TolerantStream(io.TextIOWrapper):
    is_closed_by_reader = False
    failure: OSError | None = None

    def write(self, text: str, /) -> int:
        self._try(super().write, text)
        return len(text)

    def flush(self) -> None:
        self._try(super().flush)

    def _try(self, function: Callable[..., object], *arguments: str) -> None:
        try:
            function(*arguments)
        except BrokenPipeError:
            self.is_closed_by_reader = True
        except OSError as error:
            self.failure = error


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
