"""Simulated servos behind a pseudo-terminal that any program can open as a serial port."""

from __future__ import annotations

import ctypes
import os
import select
import struct
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Final, TypeVar

from head_tracking.simulation.bus import SimulatedBus
from head_tracking.simulation.models import SimulationError
from head_tracking.simulation.serial_line import Overlap, SerialLine
from head_tracking.simulation.servo import SimulatedServo

_T = TypeVar("_T")

_STEP: Final = 30_000_000  # ns between simulation steps without requests
_CHUNK: Final = 4096
_PTYS: Final = "/dev/pts/"
_PR_SET_TIMERSLACK: Final = 29
_TCGETS2: Final = 0x802C542A
_TERMIOS2: Final = 44  # bytes of struct termios2
_SPEED_OFFSET: Final = 40  # its c_ospeed


class PseudoTerminal:
    """A pseudo-terminal; programs may open and close its device repeatedly.

    Args:
        link: Path of a symbolic link to the device; None: no link. A link to another
            pseudo-terminal is replaced.

    Attributes:
        descriptor: File descriptor of the controlling end, non-blocking.
        name: Path of the device.

    Raises:
        SimulationError: The link cannot be created.
    """

    def __init__(self, link: str | None = None) -> None:
        import tty  # not on Windows

        # While the other end is open here, a client that closes it causes no EIO.
        self.descriptor, self._slave = os.openpty()
        self.link = link
        try:
            tty.setraw(self._slave)
            os.set_blocking(self.descriptor, False)
            self.name = os.ttyname(self._slave)
            if link is not None:
                self._make_link(link)
        except BaseException:
            self._close()
            raise

    @property
    def baud_rate(self) -> int:
        """Baud rate that the program has set, bits per second."""
        import fcntl  # not on Windows

        settings = fcntl.ioctl(self._slave, _TCGETS2, bytes(_TERMIOS2))
        rate: int = struct.unpack_from("I", settings, _SPEED_OFFSET)[0]
        return rate or 38_400

    def read(self) -> bytes:
        """Return the bytes that the program has written."""
        with suppress(BlockingIOError):
            return os.read(self.descriptor, _CHUNK)
        return b""

    def write(self, data: bytes) -> None:
        """Write what fits into the buffer of the program; the rest is lost."""
        with suppress(BlockingIOError):
            os.write(self.descriptor, data)

    def close(self) -> None:
        """Remove the device, like an unplugged adapter."""
        # another program may have replaced the link
        with suppress(OSError):
            if self.link is not None and os.readlink(self.link) == self.name:
                os.unlink(self.link)
        self._close()

    def _close(self) -> None:
        os.close(self.descriptor)
        os.close(self._slave)

    def _make_link(self, link: str) -> None:
        is_replaced = os.path.islink(link) and os.readlink(link).startswith(_PTYS)
        if os.path.lexists(link) and not is_replaced:
            raise SimulationError(
                f"cannot create the link {link}: another file has this name; remove it or choose "
                "another path"
            )
        try:
            if is_replaced:
                os.unlink(link)
            os.symlink(self.name, link)
        except OSError as cause:
            raise SimulationError(
                f"cannot create the link {link}: {cause.strerror}; choose a path in a writable "
                "directory"
            ) from cause


class SimulatedPort:
    """Serves a simulated bus on a pseudo-terminal; programs open it by `port_name`.

    A context manager. Programs may open and close the device repeatedly. `close` acts like
    unplugging the adapter, `open` like plugging it in again; the servos keep their supply. A thread
    of this object owns the bus: access it by the methods here, which are thread-safe.

    Args:
        bus: The servos, or a bus.
        link: Path of a symbolic link to the device; None: no link.
        paced: Whether bytes take the time of the baud rate that the program has set.
        latency: Latency timer of the adapter, s.
        match_baud_rate: Whether only servos with the baud rate of the program receive it.
        on_failure: Called in the thread of the bus after an internal error of the simulator.

    Attributes:
        failure: The internal error that has ended the simulation; None: it works.
    """

    def __init__(
        self,
        bus: SimulatedBus | Iterable[SimulatedServo],
        *,
        link: str | os.PathLike[str] | None = None,
        paced: bool = False,
        latency: float = 0.0,
        match_baud_rate: bool = False,
        on_failure: Callable[[], object] = lambda: None,
    ) -> None:
        self.failure: BaseException | None = None
        self._needs_rate = paced or match_baud_rate
        self._bus = bus if isinstance(bus, SimulatedBus) else SimulatedBus(bus)
        self._line = SerialLine(
            self._bus, paced=paced, latency=latency, match_baud_rate=match_baud_rate
        )
        self._on_failure = on_failure
        self._link = None if link is None else os.path.abspath(os.fspath(link))
        self._clock = time.monotonic_ns
        self._lock = threading.RLock()
        self._thread: threading.Thread | None = None
        self._terminal: PseudoTerminal | None = None
        self._stopping = False

    @property
    def port_name(self) -> str:
        """Path to open: the link or the device; empty while it is closed."""
        terminal = self._terminal
        return "" if terminal is None else terminal.link or terminal.name

    def open(self) -> None:
        """Create the device and the link; raise SimulationError if the link is impossible."""
        if self._thread is not None:
            return
        self._terminal = terminal = PseudoTerminal(self._link)
        self._stopping = False
        with self._lock:
            self._bus.advance(self._clock())
        self._thread = threading.Thread(
            target=self._serve, args=(terminal,), name="simulated bus", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Remove the device and the link."""
        thread, self._thread = self._thread, None
        if thread is None:
            return
        self._stopping = True
        thread.join()
        with self._lock:
            terminal, self._terminal = self._terminal, None
            if terminal is not None:
                terminal.close()
            self._line.clear()

    def __enter__(self) -> SimulatedPort:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def use(self, function: Callable[[SimulatedBus], _T]) -> _T:
        """Call a function with the bus, simulated up to the present, and return its result."""
        with self._lock:
            self._bus.advance(self._clock())
            return function(self._bus)

    @property
    def overlaps(self) -> Counter[Overlap]:
        """Number of collisions; see `SerialLine`."""
        return self._line.overlaps

    def _serve(self, terminal: PseudoTerminal) -> None:
        with suppress(OSError, AttributeError):  # more accurate waits: the default slack is 50 us
            ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1)
        try:
            while not self._stopping:
                self._exchange(terminal, self._wait(terminal))
        except BaseException as failure:
            self.failure = failure
            with self._lock:
                self._terminal = None
                terminal.close()
            self._on_failure()
            raise

    def _exchange(self, terminal: PseudoTerminal, has_data: bool) -> None:
        now = self._clock()
        with self._lock:
            arrived = self._line.receive(now)
            if arrived:
                terminal.write(arrived)
            if has_data:
                data = terminal.read()
                self._line.send(data, now, terminal.baud_rate if self._needs_rate else 0)
            elif not arrived:
                self._bus.advance(now)

    def _wait(self, terminal: PseudoTerminal) -> bool:
        """Wait for bytes of the program; return False when an answer or a step is due first."""
        with self._lock:
            due = self._line.due or self._clock() + _STEP
        has_data = False
        while not has_data and (rest := due - self._clock()) > 0:
            has_data = bool(select.select((terminal.descriptor,), (), (), rest * 1e-9)[0])
        return has_data
