"""The reply timeout, and replies that may arrive after it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from head_tracking.dynamixel.exceptions import ReplyTimeoutError
from head_tracking.dynamixel.reading import InstructionPacket, ReadGroup

LONGEST: Final = 0.025  # s; an FTDI adapter's latency timer is 16 ms by default
_SHORTEST: Final = 0.0017  # s; the scheduler of an idle machine needs up to 1 ms
_MARGIN: Final = 0.0012  # s
_DEVIATIONS: Final = 6.0
_GAIN: Final = 1.0 / 16.0
_FORGOTTEN: Final = 0.3  # s after which no late reply arrives any more
_MOST_EXTRA: Final = 24  # bytes


class ReplyTimeout:
    """Estimate how long to wait for a reply, besides its time on the wire.

    Follows mean and mean deviation of the time between the last byte of an instruction and the last
    byte of its reply, as TCP does (RFC 6298).

    Args:
        fixed: Timeout that is always used, s; None: estimate it.
        adapter: Latency of the adapter, s; None: not known.

    Attributes:
        allowance: The timeout, s.
    """

    def __init__(self, fixed: float | None = None, adapter: float | None = None) -> None:
        self._fixed = fixed
        self._mean = self._deviation = -1.0
        if fixed is not None:
            self.allowance = fixed
        else:
            self.allowance = LONGEST if adapter is None else min(LONGEST, adapter + 0.008)

    def learn(self, latency: float) -> None:
        """Update the estimate with the latency of a reply, s."""
        if self._fixed is not None or latency > LONGEST:
            return
        mean = self._mean
        if self._deviation < 0.0:
            self._mean, self._deviation = latency, latency / 2.0
        else:
            error = latency - mean
            self._mean = mean + _GAIN * error
            self._deviation += _GAIN * ((error if error > 0.0 else -error) - self._deviation)
        wanted = self._mean + _DEVIATIONS * self._deviation + _MARGIN
        if wanted < _SHORTEST:
            wanted = _SHORTEST
        self.allowance = wanted if wanted < LONGEST else LONGEST

    def back_off(self) -> None:
        """Double the timeout until the next reply, as TCP does after a timeout."""
        if self._fixed is None:
            self.allowance = min(2.0 * self.allowance, LONGEST)


class LateReplies:
    """Replies that may still arrive after their timeout."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.due: dict[tuple[int, int, int], list[float]] = {}
        """When they were expected, s, oldest first, by protocol, id, and bytes of data."""
        self._clock = clock

    def add(self, instruction: InstructionPacket, due: float) -> None:
        """Record that a reply, expected at time `due` in s, has not arrived."""
        key = instruction.protocol, instruction.id, instruction.length
        self.due.setdefault(key, []).append(due)

    def similar(self, instruction: InstructionPacket) -> int:
        """Return how many late replies have the length of the reply to this instruction."""
        return len(self.due.get((instruction.protocol, instruction.id, instruction.length), ()))

    def unambiguous(self, group: ReadGroup) -> ReadGroup:
        """Return the group, or one that reads more bytes, whose replies differ from late ones.

        Raises:
            ReplyTimeoutError: There is none, after many failures within a short time.
        """
        self.expire()
        for extra in range(_MOST_EXTRA + 1):
            longer = group.extended(extra) if extra else group
            if not any(map(self.similar, longer.replies)):
                return longer
        raise ReplyTimeoutError(f"servo {group.ids[0]} has not answered many times")

    def remove(self, protocol: int, servo_id: int, length: int) -> float | None:
        """Remove a late reply that has arrived; return its delay, s, or None if none is due."""
        key = protocol, servo_id, length
        due = self.due.get(key)
        if not due:
            return None
        oldest = due.pop(0)
        if not due:
            del self.due[key]
        return self._clock() - oldest

    def expire(self) -> None:
        """Remove replies that are too old to arrive."""
        oldest = self._clock() - _FORGOTTEN
        kept = {reply: [when for when in due if when >= oldest] for reply, due in self.due.items()}
        self.due = {reply: due for reply, due in kept.items() if due}
