"""A serial port that does not exist: a simulated bus behind a pty."""

from __future__ import annotations

import os
import select
import threading
import time
import tty
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from types import TracebackType
from typing import Final, Self, TypeVar

from head_tracking.simulation.bus import Answer, SimulatedBus
from head_tracking.simulation.exceptions import PortLinkError
from head_tracking.simulation.servo import SimulatedServo

_T = TypeVar("_T")

_TICK: Final = 30_000_000  # ns between looks at a moving servo that nobody asks
_CHUNK: Final = 4096
_STOP: Final = b"s"
_LOOK: Final = b"l"


class SimulatedPort:
    """Serves a simulated bus on a pty, which any Dynamixel program can open by `port_name`.

    A context manager. Programs may open and close the port as often as they like; what nobody
    reads is lost, as on a wire. The bus belongs to the server's thread: look at it and touch it
    through the methods here, from any thread.

    Args:
        bus: The servos, or a bus.
        link: Path at which a symbolic link to the pty is made, so that it has a stable name.
        clock: Monotonic time, ns.
    """

    def __init__(
        self,
        bus: SimulatedBus | Iterable[SimulatedServo],
        *,
        link: str | os.PathLike[str] | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._bus = bus if isinstance(bus, SimulatedBus) else SimulatedBus(bus)
        self._link = None if link is None else os.path.abspath(os.fspath(link))
        self._clock = clock
        self._lock = threading.RLock()
        self._outgoing: deque[tuple[int, bytes]] = deque()
        self._thread: threading.Thread | None = None
        self._master = self._slave = self._wake_reader = self._wake_writer = -1
        self._name = ""

    @property
    def port_name(self) -> str:
        """Device to open: the link if there is one, else the pty; empty while closed."""
        return self._link if self._link is not None and self._name else self._name

    def open(self) -> None:
        """Make the pty and start to serve it.

        Raises:
            PortLinkError: The link cannot be made.
        """
        if self._thread is not None:
            return
        # The slave stays open here too: else the master reads EIO whenever a client closes it.
        self._master, self._slave = os.openpty()
        try:
            tty.setraw(self._slave)
            os.set_blocking(self._master, False)
            self._name = os.ttyname(self._slave)
            self._make_link()
            self._wake_reader, self._wake_writer = os.pipe()
        except BaseException:
            self._close_descriptors()
            raise
        with self._lock:
            self._bus.advance(self._clock())
        self._thread = threading.Thread(target=self._serve, name="simulated bus", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop serving and remove the pty: a program that has it open sees its port vanish."""
        thread, self._thread = self._thread, None
        if thread is None:
            return
        os.write(self._wake_writer, _STOP)
        thread.join()
        self._remove_link()
        with self._lock:
            self._close_descriptors()

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
                os.write(self._wake_writer, _LOOK)
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

    # Server's thread

    def _serve(self) -> None:
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        poll.register(self._wake_reader, select.POLLIN)
        while True:
            ready = dict(poll.poll(self._patience()))
            if self._wake_reader in ready and _STOP in os.read(self._wake_reader, _CHUNK):
                return
            now = self._clock()
            data = self._receive() if self._master in ready else b""
            with self._lock:
                answers = self._bus.receive(data, now) if data else []
                if not data:
                    self._bus.advance(now)
            for answer in answers:
                self._queue(answer, now)
            self._send_due()

    def _patience(self) -> float | None:
        """Return how long to wait, ms; None for as long as nothing happens."""
        now = self._clock()
        if self._outgoing:
            return max(0.0, (self._outgoing[0][0] - now) * 1e-6)
        with self._lock:
            return None if self._bus.at_rest else _TICK * 1e-6

    def _receive(self) -> bytes:
        with suppress(BlockingIOError):
            return os.read(self._master, _CHUNK)
        return b""

    def _queue(self, answer: Answer, now: int) -> None:
        due = now + answer.delay
        if self._outgoing:
            due = max(due, self._outgoing[-1][0])  # one wire: answers do not overtake each other
        self._outgoing.append((due, answer.data))

    def _send_due(self) -> None:
        while self._outgoing and self._outgoing[0][0] <= self._clock():
            _, data = self._outgoing.popleft()
            with suppress(BlockingIOError):  # nobody reads and the pty is full
                os.write(self._master, data)

    # Resources

    def _make_link(self) -> None:
        if self._link is None:
            return
        if os.path.lexists(self._link) and not os.path.islink(self._link):
            self._name = ""
            raise PortLinkError(
                f"cannot make the link {self._link}: something else has that name; remove it or "
                "choose another path"
            )
        try:
            with suppress(FileNotFoundError):
                os.unlink(self._link)
            os.symlink(self._name, self._link)
        except OSError as cause:
            self._name = ""
            raise PortLinkError(
                f"cannot make the link {self._link}: {cause.strerror}; choose a path in a "
                "directory you may write to"
            ) from cause

    def _remove_link(self) -> None:
        # Only if it is still ours: another simulator may have taken the path over.
        with suppress(OSError):
            if self._link is not None and os.readlink(self._link) == self._name:
                os.unlink(self._link)

    def _close_descriptors(self) -> None:
        descriptors = (self._master, self._slave, self._wake_reader, self._wake_writer)
        self._master = self._slave = self._wake_reader = self._wake_writer = -1
        self._name = ""
        self._outgoing.clear()
        for descriptor in descriptors:
            if descriptor >= 0:
                os.close(descriptor)
