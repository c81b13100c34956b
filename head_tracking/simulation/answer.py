"""What goes back to the master."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Answer:
    """Bytes that a servo sends.

    Attributes:
        data: The bytes on the wire.
        delay: Time from the instruction to the first byte, ns.
        follows: The delay counts from the end of the answer before this one.
        late: Time by which it comes later than it should, ns; others do not wait for it.
    """

    data: bytes
    delay: int
    follows: bool = False
    late: int = 0


Line = Callable[[Answer], Iterable[Answer]]
"""What the wire does to an answer: deliver it, drop it, change it, add to it."""


def faultless(answer: Answer) -> Iterable[Answer]:
    """Deliver an answer as it is."""
    return (answer,)
