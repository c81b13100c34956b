"""The one thread that owns the servo bus."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, TypeVar

from head_tracking.dynamixel.exceptions import BusStoppedError, ConfigurationError
from head_tracking.dynamixel.servo_bus import ServoBus
from head_tracking.dynamixel.servo_state import BusReading

_T = TypeVar("_T")
_SECOND = 1_000_000_000


class CycleSchedule:
    """When cycles are due: on a fixed grid, so that they do not drift.

    Args:
        period: Time between cycles, ns.
        start: When the first one is due, ns.

    Attributes:
        due: When the next cycle is due, ns.
        missed: Cycles left out so far because the one before took too long.
    """

    def __init__(self, period: int, start: int) -> None:
        self.due = start
        self.missed = 0
        self._period = period

    def advance(self, now: int) -> None:
        """Move on to the next cycle that is not past; those in between are left out, not made up.

        Args:
            now: End of the cycle that was due, ns.
        """
        self.due += self._period
        if self.due < now:
            late = (now - self.due) // self._period + 1
            self.missed += late
            self.due += late * self._period


@dataclass(frozen=True, slots=True)
class BusTiming:
    """How the cycle keeps up.

    Attributes:
        update_rate: Cycles per second wanted.
        reached_rate: Cycles per second of the last second or so; 0 before the first.
        longest_cycle: Longest cycle so far, s.
        missed: Cycles left out because one before took too long.
    """

    update_rate: float
    reached_rate: float
    longest_cycle: float
    missed: int


class BusThread:
    """Runs a connected bus at a fixed rate and hands out its readings.

    However the thread ends, it stops and relaxes the servos and closes the port: on `stop`, when
    the port is lost, and when a callback raises.

    Args:
        bus: The bus; `connect` it first, then leave it to this thread.
        update_rate: Cycles per second.
        on_reading: Gets every reading, in this thread. It must return soon, and must not wait for
            a future of `call`.
        on_error: Gets the exception that ended the thread, after the servos were relaxed.

    Raises:
        ConfigurationError: The rate is not from 1 to 1000.
    """

    def __init__(
        self,
        bus: ServoBus,
        update_rate: float,
        on_reading: Callable[[BusReading], object],
        on_error: Callable[[BaseException], object] | None = None,
    ) -> None:
        if not 1.0 <= update_rate <= 1000.0:
            raise ConfigurationError(
                f"update_rate {update_rate} is not possible; allowed are 1 to 1000 cycles/s"
            )
        self._bus = bus
        self._update_rate = update_rate
        self._on_reading = on_reading
        self._on_error = on_error
        self._wake = threading.Condition()
        self._requests: deque[tuple[Callable[[ServoBus], Any], Future[Any]]] = deque()
        self._stopping = False
        self._ended = False
        self._error: BaseException | None = None
        self._unconfirmed: tuple[str, ...] = ()
        self._longest = 0
        self._reached = 0.0
        self._missed = 0
        self._thread = threading.Thread(target=self._run, name="servo bus", daemon=True)

    @property
    def running(self) -> bool:
        """Whether the thread runs cycles."""
        return self._thread.is_alive() and not self._ended

    @property
    def error(self) -> BaseException | None:
        """The exception that ended the thread, if one did."""
        return self._error

    @property
    def unconfirmed(self) -> tuple[str, ...]:
        """Joints that did not confirm at the end that they are relaxed."""
        return self._unconfirmed

    @property
    def timing(self) -> BusTiming:
        """How the cycle keeps up."""
        return BusTiming(self._update_rate, self._reached, self._longest * 1e-9, self._missed)

    def start(self) -> None:
        """Start the cycles."""
        self._thread.start()

    def stop(self, timeout: float = 2.0) -> None:
        """End the cycles, relax the servos, close the port; safe to call twice.

        Args:
            timeout: How long to wait for the thread, s.

        Raises:
            BusStoppedError: The thread still hangs in a callback after that time.
        """
        with self._wake:
            self._stopping = True
            self._wake.notify()
        if self._thread.ident is None:
            self._finish()
        elif self._thread is not threading.current_thread():
            self._thread.join(timeout)
            if self._thread.is_alive():
                raise BusStoppedError(
                    f"the servo bus did not end within {timeout} s; a callback does not return"
                )

    def call(self, function: Callable[[ServoBus], _T]) -> Future[_T]:
        """Run a function in the owner's thread between two cycles.

        Args:
            function: Gets the bus; for example `lambda bus: bus.set_torque(None, False)`.

        Returns:
            Its result or exception; BusStoppedError if the thread does not run (any more).
        """
        future: Future[_T] = Future()
        with self._wake:
            if not self._ended and not self._stopping:
                self._requests.append((function, future))
                self._wake.notify()
                return future
        future.set_exception(BusStoppedError("the servo bus has stopped"))
        return future

    def _run(self) -> None:
        try:
            self._run_cycles()
        except BaseException as error:  # kept and reported; the servos come first
            self._error = error
        finally:
            self._finish()
        if self._error is not None and self._on_error is not None:
            self._on_error(self._error)

    def _finish(self) -> None:
        try:
            self._unconfirmed = self._bus.close()
        finally:
            with self._wake:
                self._ended = True
                requests, self._requests = self._requests, deque()
            for _, future in requests:
                if future.set_running_or_notify_cancel():
                    future.set_exception(BusStoppedError("the servo bus has stopped"))

    def _run_cycles(self) -> None:
        schedule = CycleSchedule(round(_SECOND / self._update_rate), time.monotonic_ns())
        window_start, window_cycles = schedule.due, 0
        while self._wait(schedule.due):
            begin = time.monotonic_ns()
            reading = self._bus.step()
            end = time.monotonic_ns()
            self._longest = max(self._longest, end - begin)
            window_cycles += 1
            if end - window_start >= _SECOND:
                self._reached = window_cycles * _SECOND / (end - window_start)
                window_start, window_cycles = end, 0
            self._on_reading(reading)
            schedule.advance(time.monotonic_ns())
            self._missed = schedule.missed

    def _wait(self, due: int) -> bool:
        """Serve requests until a time, ns; return False when the thread shall end."""
        while True:
            with self._wake:
                if self._stopping:
                    return False
                if not self._requests:
                    left = due - time.monotonic_ns()
                    if left <= 0:
                        return True
                    self._wake.wait(left * 1e-9)
                    continue
                function, future = self._requests.popleft()
            self._serve(function, future)
            if due <= time.monotonic_ns():
                return not self._stopping  # a stream of requests must not starve the cycle

    def _serve(self, function: Callable[[ServoBus], Any], future: Future[Any]) -> None:
        if not future.set_running_or_notify_cancel():
            return
        try:
            result = function(self._bus)
        except Exception as error:
            future.set_exception(error)
        else:
            future.set_result(result)
