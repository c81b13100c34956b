"""What became of a question."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from head_tracking.dynamixel.protocol import Status


class Failure(Enum):
    """Why there is no answer to hand out."""

    SILENT = "no answer in time"
    DAMAGED = "a damaged answer"


Answer = Status | Failure


class Window(NamedTuple):
    """Bytes of a servo's memory, with some more than needed, so that no late answer is as long.

    Attributes:
        address: The first byte that is needed.
        length: How many are needed.
        extra: How many more are read, before them where there are as many.
    """

    address: int
    length: int
    extra: int

    @property
    def start(self) -> int:
        """Where to read from."""
        return self.address - self.extra if self.address >= self.extra else self.address

    @property
    def size(self) -> int:
        """How many bytes to read."""
        return self.length + self.extra

    def part(self, answer: Answer) -> Answer:
        """Return the answer without the bytes that nobody needs."""
        if not self.extra or not isinstance(answer, Status) or len(answer.data) != self.size:
            return answer
        offset = self.address - self.start
        return answer._replace(data=answer.data[offset : offset + self.length])
