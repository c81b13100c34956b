"""What becomes of the answers on a simulated bus, as a test decides."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from head_tracking.simulation import Answer, SimulatedBus


class OnAnswers:
    """Fault injection that passes every answer through a function; requests arrive as sent."""

    def __init__(self, answer: Callable[[Answer], Iterable[Answer]]) -> None:
        self.answer = answer

    def request(self, bus: SimulatedBus, data: bytes, now: int) -> tuple[bytes, list[Answer]]:
        return data, []
