"""A serial port that does not exist: a simulated bus behind a pty."""

from __future__ import annotations

import ctypes
import os
import select
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from queue import SimpleQueue
from types import TracebackType
from typing import Final, Self, TypeVar

from head_tracking.simulation.bus import SimulatedBus
from head_tracking.simulation.pseudo_terminal import PseudoTerminal
from head_tracking.simulation.servo import SimulatedServo
from head_tracking.simulation.wire import Wire

_T = TypeVar("_T")

_LOOK: Final = 30_000_000  # ns between looks at a moving servo that nobody asks
_CHUNK: Final = 4096
_SPIN: Final = 150_000  # ns before the end of a wait
_PR_SET_TIMERSLACK: Final = 29


class SimulatedPort:
    """Serves a simulated bus on a pty, which any Dynamixel program can open by `port_name`.

    A context manager. Programs may open and close the port as often as they like; what nobody
    reads is lost, as on a wire. The bus belongs to the server's thread: look at it and touch it
    through the methods here, from any thread.

    Args:
        bus: The servos, or a bus.
        link: Path at which a symbolic link to the pty is made, so that it has a stable name, also
            when it is unplugged and plugged in again.
        clock: Monotonic time, ns.
        paced: Whether bytes take the time that they take at the baud rate the program has set.
        latency: Period at which the adapter hands on what it received, s; 0: at once.
        match_baud_rate: Whether only servos that are set to the program's baud rate hear it.
        spinning: Burn a core at the end of each wait, to be exact to some microseconds.
    """

    def __init__(
        self,
        bus: SimulatedBus | Iterable[SimulatedServo],
        *,
        link: str | os.PathLike[str] | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
        paced: bool = False,
        latency: float = 0.0,
        match_baud_rate: bool = False,
        spinning: bool = False,
    ) -> None:
        self._bus = bus if isinstance(bus, SimulatedBus) else SimulatedBus(bus)
        self._needs_rate = paced or match_baud_rate
        self._wire = Wire(
            self._bus,
            paced=paced,
            latency=round(latency * 1e9),
            match_baud_rate=match_baud_rate,
        )
        self._link = None if link is None else os.path.abspath(os.fspath(link))
        self._clock = clock
        self._spinning = spinning
        self._lock = threading.RLock()
        self._thread: threading.Thread | None = None
        self._terminal: PseudoTerminal | None = None
        self._wake_reader = self._wake_writer = -1
        self._orders: SimpleQueue[tuple[PseudoTerminal | None, threading.Event]] = SimpleQueue()
        self._stopping = False

    @property
    def port_name(self) -> str:
        """Device to open: the link if there is one, else the pty; empty while there is none."""
        terminal = self._terminal
        return "" if terminal is None else terminal.link or terminal.name

    def open(self) -> None:
        """Make the pty and start to serve it.

        Raises:
            PortLinkError: The link cannot be made.
        """
        if self._thread is not None:
            return
        self._terminal = PseudoTerminal(self._link)
        self._wake_reader, self._wake_writer = os.pipe()
        self._stopping = False
        with self._lock:
            self._bus.advance(self._clock())
        self._thread = threading.Thread(target=self._serve, name="simulated bus", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop serving and remove the pty: a program that has it open sees its port vanish."""
        thread, self._thread = self._thread, None
        if thread is None:
            return
        self._stopping = True
        self._wake()
        thread.join()
        with self._lock:
            terminal, self._terminal = self._terminal, None
            if terminal is not None:
                terminal.close()
            self._wire.clear()
            for descriptor in (self._wake_reader, self._wake_writer):
                os.close(descriptor)
            self._wake_reader = self._wake_writer = -1

    def unplug(self) -> None:
        """Pull the adapter out: the device and the link vanish, the servos keep their supply."""
        if self._terminal is not None:
            self._order(None)

    def replug(self) -> None:
        """Plug the adapter in again: there is a device again, by another name, and the link.

        Raises:
            PortLinkError: The link cannot be made.
        """
        if self._terminal is None and self._thread is not None:
            self._order(PseudoTerminal(self._link))

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    # From any thread

    def use(self, function: Callable[[SimulatedBus], _T]) -> _T:
        """Call a function with the bus at the present time, while the server waits."""
        with self._lock:
            self._bus.advance(self._clock())
            slept = self._bus.at_rest
            result = function(self._bus)
            if slept and not self._bus.at_rest and self._wake_writer >= 0:
                self._wake()
        return result

    def true_ticks(self, servo_id: int) -> float:
        """Return the true angle of a shaft, in fractions of a tick; see `SimulatedServo`."""
        return self.use(lambda bus: bus[servo_id].true_ticks)

    def push(self, servo_id: int, torque: float) -> None:
        """Load a shaft from outside until the next call, N m, counter-clockwise."""
        self.use(lambda bus: bus[servo_id].push(torque))

    def lead(self, servo_id: int, ticks: float, duration: float, strength: float = 0.5) -> None:
        """Let a hand lead a shaft to a tick within `duration` seconds and let go there."""
        self.use(lambda bus: bus[servo_id].lead(ticks, duration, strength))

    def _wake(self) -> None:
        os.write(self._wake_writer, b"w")

    def _order(self, terminal: PseudoTerminal | None) -> None:
        done = threading.Event()
        self._orders.put((terminal, done))
        self._wake()
        done.wait()

    # Server's thread

    def _serve(self) -> None:
        _wake_up_in_time()
        while not self._stopping:
            ready = self._wait()
            if self._wake_reader in ready:
                os.read(self._wake_reader, _CHUNK)
                self._obey()
            self._exchange(self._terminal, ready)

    def _exchange(self, terminal: PseudoTerminal | None, ready: list[int]) -> None:
        now = self._clock()
        with self._lock:
            arrived = self._wire.take(now)
            if arrived and terminal is not None:
                terminal.write(arrived)
            if terminal is not None and terminal.descriptor in ready:
                data = terminal.read()
                self._wire.send(data, now, terminal.baud_rate if self._needs_rate else 0)
            elif not arrived:
                self._bus.advance(now)

    def _obey(self) -> None:
        while not self._orders.empty():
            terminal, done = self._orders.get()
            old, self._terminal = self._terminal, terminal
            if old is not None:
                old.close()
            with self._lock:
                self._wire.clear()
            done.set()

    def _wait(self) -> list[int]:
        """Wait until there is something to do; return the descriptors that have something."""
        watched = [self._wake_reader]
        if self._terminal is not None:
            watched.append(self._terminal.descriptor)
        with self._lock:
            due = self._wire.due
            if due is None and not self._bus.at_rest:
                due = self._clock() + _LOOK
        if due is None:
            return select.select(watched, (), ())[0]
        ready: list[int] = []
        while not ready and (rest := due - self._clock()) > 0:
            pause = max(0, rest - _SPIN) if self._spinning else rest
            ready = select.select(watched, (), (), pause * 1e-9)[0]
        return ready


def _wake_up_in_time() -> None:
    """Let this thread's waits end when they should, not up to 50 us later."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1)
