"""How long a reply is waited for, and which replies may still come afterwards."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from head_tracking.dynamixel.exceptions import ReplyTimeoutError
from head_tracking.dynamixel.protocol import Status
from head_tracking.dynamixel.reading import ReadGroup, Request

LONGEST: Final = 0.025
"""s. Leaves room for an FTDI adapter's 16 ms, its setting from the factory."""
_SHORTEST: Final = 0.0017
"""s. A quiet machine wakes the reader up within a millisecond; less would cry wolf."""
_MARGIN: Final = 0.0012
_DEVIATIONS: Final = 6.0
_GAIN: Final = 1.0 / 16.0
_FORGOTTEN: Final = 1.0
"""s after which no reply is still on its way, through whatever adapter."""
_MOST_EXTRA: Final = 24  # bytes


class ReplyTimeout:
    """How long a reply is waited for besides its time on the wire.

    Follows the time between the last byte of a request and the last byte of its reply: the servo's
    return delay, the adapter's latency and the time until this program runs. Mean and mean
    deviation are followed as TCP does it (RFC 6298).

    Args:
        fixed: Always allow this time, s, instead; None follows.
        adapter: What the adapter is known to take, s; None if that is not known.

    Attributes:
        allowance: That time, s.
    """

    def __init__(self, fixed: float | None = None, adapter: float | None = None) -> None:
        self._fixed = fixed
        self._mean = self._deviation = -1.0
        if fixed is not None:
            self.allowance = fixed
        else:
            self.allowance = LONGEST if adapter is None else min(LONGEST, adapter + 0.008)

    def learn(self, latency: float) -> None:
        """Take account of a reply, unless it took too long to ever wait for; s."""
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
        """Allow twice the time until the next reply, as TCP does when a reply has not come."""
        if self._fixed is None:
            self.allowance = min(2.0 * self.allowance, LONGEST)


class LateReplies:
    """Replies that may still come after the wait for them has ended.

    Args:
        clock: Monotonic time, s.

    Attributes:
        due: When they were due, s, by protocol and id, and by bytes of data.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self.due: dict[tuple[int, int], dict[int, float]] = {}
        self._clock = clock

    def add(self, request: Request, due: float) -> None:
        """Note that the reply to a request may still come; it was due at a time, s."""
        self.due.setdefault((request.protocol, request.id), {})[request.length] = due

    def resembles(self, request: Request) -> bool:
        """Return whether the reply to a request has the length of a late one."""
        return request.length in self.due.get((request.protocol, request.id), ())

    def expect(self, request: Request) -> None:
        """Count a late reply of the length of the reply to a request as that reply."""
        self.due.get((request.protocol, request.id), {}).pop(request.length, None)

    def distinct(self, group: ReadGroup) -> ReadGroup:
        """Return the group, or a longer one, whose replies have the length of no late reply.

        Raises:
            ReplyTimeoutError: There is none, after many failures in a second.
        """
        if not self.due:
            return group
        self.forget()
        for extra in range(_MOST_EXTRA + 1):
            longer = group.longer(extra) if extra else group
            if not any(map(self.resembles, longer.requests)):
                return longer
        raise ReplyTimeoutError(f"servo {group.ids[0]} has not answered many times")

    def take(self, protocol: int, status: Status) -> float | None:
        """Note that such a reply has come; return how late it is, s, or None if none is due."""
        due = self.due.get((protocol, status.id), {}).pop(len(status.data), None)
        self.forget()
        return None if due is None else self._clock() - due

    def forget(self) -> None:
        """Drop what is too old to come."""
        oldest = self._clock() - _FORGOTTEN
        for key, late in list(self.due.items()):
            recent = {length: due for length, due in late.items() if due >= oldest}
            self.due[key] = recent
            if not recent:
                del self.due[key]
