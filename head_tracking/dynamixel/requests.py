"""Requests and goals for one bus, in the order in which they were made. STOP overtakes them.

STOP advances the epoch before anything else. Each request and each goal has the epoch in which it
was made, and is discarded, where it would be carried out, if that epoch is over.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Generator, Mapping
from concurrent.futures import Future, InvalidStateError
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Final, TypeVar

from head_tracking.dynamixel.exceptions import BusStoppedError, PortLostError, StoppedError
from head_tracking.dynamixel.state import Goal

_T = TypeVar("_T")
Steps = Generator[float, None, _T]
"""Steps of a procedure; each yields the seconds to wait before the next one.

The bus does other things meanwhile, because it spreads steps over its cycles; `servo.run` takes
them at once.
"""

_STOPPED: Final = "STOP came after this request; call resume, then send it again"
_CLOSED: Final = "the servo bus has stopped"


class Epoch:
    """Counts STOPs, for everything that is stopped together. For any thread."""

    def __init__(self) -> None:
        self.value = 0
        self._lock = threading.Lock()

    def advance(self) -> int:
        """Begin a new epoch and return its number."""
        with self._lock:
            self.value += 1
            return self.value


@dataclass(slots=True, eq=False)
class Request:
    """A request to the thread that owns the bus."""

    function: Callable[[], Any]  # carries it out, or returns the steps that do
    epoch: int  # in which it was made
    despite_stop: bool = False  # carry it out although STOP came after it, because it moves nothing
    future: Future[Any] = field(default_factory=Future)  # cancelling it ends the request
    steps: Steps[Any] | None = None  # the remaining ones, once it has begun
    due: int = 0  # monotonic time before which no step is taken, ns

    def answer(self, error: BaseException | None, result: Any = None) -> None:
        """Set an error or a result, unless the future is done."""
        with suppress(InvalidStateError):
            if error is None:
                self.future.set_result(result)
            else:
                self.future.set_exception(error)


class RequestQueue:
    """The requests and the goals of one bus.

    Any thread may call `add`, `put_goals`, `drop_goals` and `close`; the thread that owns the bus
    calls the others.

    Args:
        epoch: Shared with everything that one STOP stops.

    Attributes:
        obeyed: The last epoch whose STOP the bus has carried out; requests that the bus itself
            starts are of this epoch.
        arrived: Notified when a request has arrived or the queue has been closed.
        under_way: Requests that have begun, in turn.
        goals: Goals that have not been accepted, by joint.
    """

    def __init__(self, epoch: Epoch, monotonic: Callable[[], int]) -> None:
        self.epoch = epoch
        self.obeyed = epoch.value
        self.arrived = threading.Condition()
        self.under_way: deque[Request] = deque()
        self.goals: dict[str, Goal] = {}
        self.closed = False
        self._goals_epoch = 0
        self._lock = threading.Lock()
        self._waiting: deque[Request] = deque()
        self._monotonic = monotonic

    # Any thread

    def add(
        self, function: Callable[[], Any], epoch: int | None = None, despite_stop: bool = False
    ) -> Future[Any]:
        """Add a request; it is carried out between two cycles.

        Args:
            function: Carries it out, or returns steps: they are taken in the next cycles, the first
                at once. Cancelling the future ends them.
            epoch: In which the request was made; None: the present one.
            despite_stop: See `Request`.

        Returns:
            Its result or exception: StoppedError if STOP came after it was made, BusStoppedError if
            the thread does not run.
        """
        request = Request(function, self.epoch.value if epoch is None else epoch, despite_stop)
        with self.arrived:
            if not self.closed:
                self._waiting.append(request)
                self.arrived.notify()
                return request.future
        request.answer(BusStoppedError(_CLOSED))
        return request.future

    def put_goals(self, goals: Mapping[str, Goal], epoch: int) -> None:
        """Add goals that were made in an epoch; they replace those of the same joints.

        Raises:
            StoppedError: That epoch is over.
        """
        with self._lock:
            self.check(epoch)
            if epoch != self._goals_epoch:
                self.goals.clear()
                self._goals_epoch = epoch
            self.goals.update(goals)

    def drop_goals(self, joint: str | None = None) -> None:
        """Remove the goal of a joint, or all goals."""
        with self._lock:
            if joint is None:
                self.goals.clear()
            else:
                self.goals.pop(joint, None)

    def close(self) -> None:
        """Refuse requests from now on; those that have not begun fail with BusStoppedError."""
        with self.arrived:
            self.closed = True
            waiting, self._waiting = self._waiting, deque()
            self.arrived.notify_all()
        for request in waiting:
            request.answer(BusStoppedError(_CLOSED))

    def check(self, epoch: int) -> None:
        """Raise StoppedError if an epoch is over."""
        if epoch < self.epoch.value:
            raise StoppedError(_STOPPED)

    # Thread that owns the bus

    def take_goal(self, joint: str) -> Goal | None:
        """Remove the goal of a joint and return it, unless STOP came after it."""
        with self._lock:
            goal = self.goals.pop(joint, None)
            return goal if self._goals_epoch == self.epoch.value else None

    def has_waiting(self) -> bool:
        """Return whether a request has not begun."""
        return bool(self._waiting)

    def begin_next(self) -> None:
        """Begin the oldest request that has not begun: take its first step."""
        with self.arrived:
            if not self._waiting:
                return
            request = self._waiting.popleft()
        self.under_way.append(request)
        with suppress(PortLostError):  # the next cycle notices it
            self.advance(request)

    def start(self, steps: Steps[Any], *, despite_stop: bool = False) -> Request:
        """Add steps without taking the first one; see `Request`."""
        request = Request(lambda: steps, self.obeyed, despite_stop)
        self.under_way.append(request)
        return request

    def next_due(self, now: int) -> Request | None:
        """Return the next request with a step that is due; `now` in ns."""
        for _ in range(len(self.under_way)):
            request = self.under_way[0]
            self.under_way.rotate(-1)
            if request.due <= now or request.future.cancelled():
                return request
        return None

    def advance(self, request: Request) -> None:
        """Take one step of a request; raise PortLostError if the port was lost."""
        if request.future.cancelled():
            self.end(request, None)
            return
        if request.epoch < self.epoch.value and not request.despite_stop:
            self.end(request, StoppedError(_STOPPED))
            return
        try:
            if request.steps is None:
                result = request.function()
                if not isinstance(result, Generator):
                    self.end(request, None, result)
                    return
                request.steps = result
            wait = next(request.steps)
        except StopIteration as end:
            self.end(request, None, end.value)
        except Exception as error:
            self.end(request, error)
            if isinstance(error, PortLostError):
                raise
        else:
            request.due = self._monotonic() + round(wait * 1e9) if wait > 0.0 else 0

    def end(self, request: Request, error: BaseException | None, result: Any = None) -> None:
        """Take no more steps of a request, and answer it."""
        with suppress(ValueError):
            self.under_way.remove(request)
        if request.steps is not None:
            with suppress(Exception):
                request.steps.close()
        request.answer(error, result)

    def end_all(self, error: BaseException) -> None:
        """End all requests under way."""
        for request in list(self.under_way):
            self.end(request, error)

    def discard(self) -> None:
        """End the requests under way, except those that go on despite STOP."""
        for request in list(self.under_way):
            if not request.despite_stop:
                self.end(request, StoppedError(_STOPPED))
