"""The thread that owns a servo bus."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from head_tracking.dynamixel.bus import ServoBus
from head_tracking.dynamixel.exceptions import BusStoppedError
from head_tracking.dynamixel.state import BusReading

_T = TypeVar("_T")
_SECOND = 1_000_000_000
_CLOSING = 10.0  # s that braking, and asking every servo several times, may take in addition


@dataclass(slots=True)
class BusTiming:
    """Timing of the cycle."""

    update_rate: float  # configured cycles per second
    reached_rate: float = 0.0  # cycles per second in the last second; 0 before it has passed
    longest_cycle: float = 0.0  # longest cycle so far, s
    missed: int = 0  # cycles left out because an earlier one took too long


class BusThread:
    """Runs the cycles of a connected bus at a fixed rate.

    At its end, also when the port is lost or a callback raises, it brakes and relaxes the servos
    and closes the port.

    Args:
        bus: The bus, already connected.
        update_rate: Cycles per second, 1 to 1000.
        on_reading: Called with every reading, in this thread. It must return soon, and must not
            wait for the future of a request.
        on_error: Called with the exception that ended the thread, after the servos were relaxed.
        update: Called with every reading before the goals are written, in this thread, to command
            the bus. Other threads can use the bus meanwhile.

    Attributes:
        timing: Timing of the cycle.
        unconfirmed: Joints that did not confirm at the end that they are relaxed.
    """

    def __init__(
        self,
        bus: ServoBus,
        update_rate: float,
        on_reading: Callable[[BusReading], object],
        on_error: Callable[[BaseException], object] = lambda _: None,
        update: Callable[[BusReading], object] = lambda _: None,
    ) -> None:
        self.bus = bus
        self._on_reading = on_reading
        self._on_error = on_error
        self._update = update
        self._requests = bus.requests
        self._wake = bus.requests.arrived
        self._owner = threading.Lock()  # held while the bus is used
        self._stopping = False
        self._closing = False
        self.unconfirmed: tuple[str, ...] = ()
        self.timing = BusTiming(update_rate)
        self._thread = threading.Thread(target=self._run, name="servo bus", daemon=True)

    def start(self) -> None:
        """Start the cycles."""
        self._thread.start()

    def ask_to_stop(self) -> None:
        """Ask the thread to end, without waiting for it."""
        with self._wake:
            self._stopping = True
            self._wake.notify()

    def stop(self, timeout: float = 2.0) -> None:
        """End the cycles, brake and relax the servos, close the port; may be called twice.

        If the thread hangs in a callback, the servos are relaxed from the calling thread.

        Args:
            timeout: How long to wait for the thread, s; while it brakes and relaxes, longer.

        Raises:
            BusStoppedError: The thread did not end: a callback hangs (the servos were relaxed), or
                the port hangs (they were not).
        """
        self.ask_to_stop()
        if self._thread.ident is None:
            self._finish()
        elif self._thread is not threading.current_thread():
            self._thread.join(timeout)
            if self._thread.is_alive() and self._closing:
                self._thread.join(_CLOSING)
            if self._thread.is_alive():
                why = "its port hangs, and the servos may have torque on"
                if self._owner.acquire(timeout=timeout):
                    self._owner.release()
                    self._finish()
                    why = "a callback does not return. The servos were relaxed without it"
                raise BusStoppedError(
                    f"the servo bus on {self.bus.port.name} did not end within {timeout} s; {why}"
                )

    def at_once(self, function: Callable[[ServoBus], _T], timeout: float) -> _T:
        """Run a function in the calling thread as soon as the port is free.

        Args:
            function: Called with the bus; it must not wait for steps.
            timeout: How long to wait for the port, s.

        Raises:
            BusStoppedError: The bus has stopped, or the port is not free in time.
        """
        if not self._owner.acquire(timeout=timeout):
            raise BusStoppedError(f"the port {self.bus.port.name} was not free for {timeout:.2f} s")
        try:
            if self._requests.closed:
                raise BusStoppedError("the servo bus has stopped")
            return function(self.bus)
        finally:
            self._owner.release()

    def _run(self) -> None:
        failure: BaseException | None = None
        for work in (self._run_cycles, self._finish):
            try:
                work()
            except BaseException as error:  # reported after the servos were relaxed
                failure = failure or error
        if failure is not None:
            self._on_error(failure)

    def _finish(self) -> None:
        """Close the bus once."""
        with self._owner:
            if self._requests.closed:
                return
            self._closing = True
            self.unconfirmed = tuple(joint.joint_name for joint in self.bus.joints)
            try:
                self.unconfirmed = self.bus.close()
            finally:
                self._requests.close()

    def _run_cycles(self) -> None:
        timing, due = self.timing, time.monotonic_ns()
        period = round(_SECOND / timing.update_rate)
        window_start, window_cycles = due, 0
        while self._wait(due):
            begin = time.monotonic_ns()
            with self._owner:
                if self._requests.closed:  # another thread has closed the bus
                    return
                reading = self.bus.cycle.read()
            self._update(reading)
            with self._owner:
                if self._requests.closed:
                    return
                reading = self.bus.cycle.write(reading)
            end = time.monotonic_ns()
            timing.longest_cycle = max(timing.longest_cycle, (end - begin) * 1e-9)
            window_cycles += 1
            if end - window_start >= _SECOND:
                timing.reached_rate = window_cycles * _SECOND / (end - window_start)
                window_start, window_cycles = end, 0
            self._on_reading(reading)
            # On a fixed grid, so that cycles do not drift.
            late = max(0, time.monotonic_ns() - due - 1) // period
            timing.missed += late
            due += (late + 1) * period

    def _wait(self, due: int) -> bool:
        """Begin requests and take steps until a time, ns; return False at the end of the thread.

        A stream of requests does not delay the cycle.
        """
        while not self._stopping:
            with self._owner:
                if self._requests.closed:
                    return False
                if found := self._requests.has_waiting():
                    self._requests.begin_next()
                else:
                    found = self.bus.cycle.fill(due)
            left = due - time.monotonic_ns()
            if left <= 0:
                return not self._stopping
            with self._wake:
                if not (found or self._stopping or self._requests.has_waiting()):
                    self._wake.wait(left * 1e-9)
        return False
