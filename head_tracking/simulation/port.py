"""A serial port that does not exist: a simulated bus behind a pseudo-terminal."""

from __future__ import annotations

import ctypes
import fcntl
import os
import select
import socket
import struct
import threading
import time
import tty
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from hashlib import sha256
from typing import TYPE_CHECKING, Final, Protocol, TypeVar

from head_tracking.simulation.bus import SimulatedBus
from head_tracking.simulation.exceptions import PortLinkError
from head_tracking.simulation.models import Named, simulated_model
from head_tracking.simulation.serial_line import Overlap, SerialLine
from head_tracking.simulation.servo import SimulatedServo

if TYPE_CHECKING:
    from typing import Self

_T = TypeVar("_T")

_LOOK: Final = 30_000_000  # ns between looks at a moving servo that nobody asks
_CHUNK: Final = 4096
_SPIN: Final = 150_000  # ns before the end of a wait
_PTYS: Final = "/dev/pts/"
_PR_SET_TIMERSLACK: Final = 29
_TCGETS2: Final = 0x802C542A
_TERMIOS2: Final = 44  # bytes of struct termios2
_SPEED_OFFSET: Final = 40  # its c_ospeed


class PseudoTerminal:
    """A device that programs may open and close as often as they like.

    Args:
        link: Path of a symbolic link to the device; None for none.

    Attributes:
        descriptor: The end behind the device, non-blocking.
        name: The device.

    Raises:
        PortLinkError: The link cannot be made.
    """

    def __init__(self, link: str | None = None) -> None:
        # The slave stays open here too: else the master reads EIO whenever a client closes it.
        self.descriptor, self._slave = os.openpty()
        self._claim = socket.socket(socket.AF_UNIX)
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
        """Bits per second that the program has set."""
        settings = fcntl.ioctl(self._slave, _TCGETS2, bytes(_TERMIOS2))
        rate: int = struct.unpack_from("I", settings, _SPEED_OFFSET)[0]
        return rate or 38_400

    def read(self) -> bytes:
        """Return what the program has written."""
        with suppress(BlockingIOError):
            return os.read(self.descriptor, _CHUNK)
        return b""

    def write(self, data: bytes) -> None:
        """Write as much as the program has room for; the rest is lost, as on a wire."""
        with suppress(BlockingIOError):
            os.write(self.descriptor, data)

    def close(self) -> None:
        """Remove the device: a program that has it open sees it vanish."""
        # Only if the link is still ours: somebody may have put another one there.
        with suppress(OSError):
            if self.link is not None and os.readlink(self.link) == self.name:
                os.unlink(self.link)
        self._close()

    def _close(self) -> None:
        self._claim.close()
        os.close(self.descriptor)
        os.close(self._slave)

    def _make_link(self, link: str) -> None:
        if os.path.lexists(link) and not os.path.islink(link):
            raise PortLinkError(
                f"cannot make the link {link}: something else has that name; remove it or "
                "choose another path"
            )
        target = os.path.realpath(link)
        # Where a link of ours leads tells nothing: the system gives a killed program's pty out
        # again. The name in the kernel ends with whoever holds it, however they end.
        taken = os.path.exists(target) and os.path.islink(link) and not target.startswith(_PTYS)
        try:
            self._claim.bind(_claim_of(link))
        except OSError:
            taken = True
        if taken:
            raise PortLinkError(
                f"cannot make the link {link}: it leads to {target}, which is in use, "
                "perhaps by another simulated bus; end that one, or choose another path"
            )
        try:
            if os.path.islink(link):
                os.unlink(link)
            os.symlink(self.name, link)
        except OSError as cause:
            raise PortLinkError(
                f"cannot make the link {link}: {cause.strerror}; choose a path in a "
                "directory you may write to"
            ) from cause


def _claim_of(link: str) -> bytes:
    """Return the abstract socket address of whoever serves a link."""
    directory, name = os.path.split(link)
    path = os.path.join(os.path.realpath(directory), name)
    return b"\0head_tracking " + sha256(os.fsencode(path)).hexdigest().encode()


class SimulatedPort:
    """Serves a simulated bus on a pty, which any Dynamixel program can open by `port_name`.

    A context manager. Programs may open and close the device as often as they like; what nobody
    reads is lost, as on a wire. `close` is how the adapter is unplugged, and `open` how it is
    plugged in again: the servos keep their supply. The bus belongs to the server's thread: look at
    it and touch it through the methods here, from any thread.

    Args:
        bus: The servos, or a bus.
        link: Path at which a symbolic link to the pty is made, so that it has a stable name, also
            when it is unplugged and plugged in again.
        paced: Whether bytes take the time that they take at the baud rate the program has set.
        latency: Period at which the adapter hands on what it received, s; 0: at once.
        match_baud_rate: Whether only servos that are set to the program's baud rate hear it.
        spinning: Burn a core at the end of each wait, to be exact to some microseconds.
        on_failure: Called, in the server's thread, if the simulator itself fails.

    Attributes:
        failure: What the simulator failed of: the port has vanished then; None: it has not.
    """

    def __init__(
        self,
        bus: SimulatedBus | Iterable[SimulatedServo],
        *,
        link: str | os.PathLike[str] | None = None,
        paced: bool = False,
        latency: float = 0.0,
        match_baud_rate: bool = False,
        spinning: bool = False,
        on_failure: Callable[[], object] = lambda: None,
    ) -> None:
        self.failure: BaseException | None = None
        self._bus = bus if isinstance(bus, SimulatedBus) else SimulatedBus(bus)
        self._needs_rate = paced or match_baud_rate
        self._line = SerialLine(
            self._bus,
            paced=paced,
            latency=round(latency * 1e9),
            match_baud_rate=match_baud_rate,
        )
        self._on_failure = on_failure
        self._link = None if link is None else os.path.abspath(os.fspath(link))
        self._clock = time.monotonic_ns
        self._spinning = spinning
        self._lock = threading.RLock()
        self._thread: threading.Thread | None = None
        self._terminal: PseudoTerminal | None = None
        self._wake_reader = self._wake_writer = -1
        self._stopping = False

    @property
    def port_name(self) -> str:
        """Device to open: the link if there is one, else the pty; empty while there is none."""
        terminal = self._terminal
        return "" if terminal is None else terminal.link or terminal.name

    def open(self) -> None:
        """Make the pty, by another name than before, and the link, and start to serve it.

        Raises:
            PortLinkError: The link cannot be made.
        """
        if self._thread is not None:
            return
        self._terminal = terminal = PseudoTerminal(self._link)
        self._wake_reader, self._wake_writer = os.pipe()
        self._stopping = False
        with self._lock:
            self._bus.advance(self._clock())
        self._thread = threading.Thread(
            target=self._serve, args=(terminal,), name="simulated bus", daemon=True
        )
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
            self._line.clear()
            for descriptor in (self._wake_reader, self._wake_writer):
                os.close(descriptor)
            self._wake_reader = self._wake_writer = -1

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
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

    @property
    def overlaps(self) -> Counter[Overlap]:
        """How often two spoke at the same time; only a paced port can tell, but for twins."""
        return self._line.overlaps

    def push(self, servo_id: int, torque: float) -> None:
        """Load a shaft from outside until the next call, N m, counter-clockwise."""
        self.use(lambda bus: bus[servo_id].push(torque))

    def lead(self, servo_id: int, ticks: float, duration: float) -> None:
        """Let a hand lead a shaft to a tick within `duration` seconds and let go there."""
        self.use(lambda bus: bus[servo_id].lead(ticks, duration))

    def _wake(self) -> None:
        os.write(self._wake_writer, b"w")

    # Server's thread

    def _serve(self, terminal: PseudoTerminal) -> None:
        with suppress(OSError, AttributeError):  # waits end in time, not up to 50 us later
            ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1)
        try:
            while not self._stopping:
                ready = self._wait(terminal)
                if self._wake_reader in ready:
                    os.read(self._wake_reader, _CHUNK)
                self._exchange(terminal, ready)
        except BaseException as failure:
            self.failure = failure
            with self._lock:
                self._terminal = None
                terminal.close()
            self._on_failure()
            raise

    def _exchange(self, terminal: PseudoTerminal, ready: list[int]) -> None:
        now = self._clock()
        with self._lock:
            arrived = self._line.take(now)
            if arrived:
                terminal.write(arrived)
            if terminal.descriptor in ready:
                data = terminal.read()
                self._line.send(data, now, terminal.baud_rate if self._needs_rate else 0)
            elif not arrived:
                self._bus.advance(now)

    def _wait(self, terminal: PseudoTerminal) -> list[int]:
        """Wait until there is something to do; return the descriptors that have something."""
        watched = [self._wake_reader, terminal.descriptor]
        with self._lock:
            due = self._line.due
            if due is None and not self._bus.at_rest:
                due = self._clock() + _LOOK
        if due is None:
            return select.select(watched, (), ())[0]
        ready: list[int] = []
        while not ready and (rest := due - self._clock()) > 0:
            pause = max(0, rest - _SPIN) if self._spinning else rest
            ready = select.select(watched, (), (), pause * 1e-9)[0]
        return ready


class Mount(Protocol):
    """How one servo drives its joint, such as the driver's `ServoCalibration`."""

    @property
    def id(self) -> int:
        """Servo id."""

    @property
    def model(self) -> Named:
        """Its model."""

    @property
    def init(self) -> int:
        """Tick of position 0."""

    @property
    def direction(self) -> int:
        """-1 if rising ticks are falling positions, else 1."""

    @property
    def offset(self) -> int | None:
        """What its memory adds to its position, ticks; None: nothing."""

    @property
    def reverse(self) -> bool | None:
        """Whether its Drive Mode counts ticks in reverse; None: it does not."""


class Mounting(Protocol):
    """How servos drive a joint, such as the driver's `JointConfiguration`."""

    @property
    def joint_name(self) -> str:
        """The joint."""

    @property
    def calibrations(self) -> Sequence[Mount]:
        """Its servos."""

    def position(self, ticks: float) -> float:
        """Return the position of the joint, rad."""


class SimulatedJoints:
    """The servos of a configuration, simulated: a port to open, and the truth about the joints.

    They stand at position 0 at first, on a wire that takes its time. A context manager. A stiff
    bracket joins two servos on one joint.

    Args:
        joints: as they are configured.
        link_play: behind each encoder; see `SimulatedServo` [rad].

    Attributes:
        port: the port of the bus that they share.
    """

    def __init__(self, joints: Iterable[Mounting], link_play: float = 0.0) -> None:
        self._joints = {joint.joint_name: joint for joint in joints}
        self.port = SimulatedPort(mounted_servos(self._joints.values(), link_play), paced=True)

    @property
    def port_name(self) -> str:
        """What a driver opens."""
        return self.port.port_name

    def true_position(self, joint_name: str) -> float:
        """Where the joint really is [rad], finer than any encoder tells."""
        joint = self._joints[joint_name]
        return joint.position(self.port.true_ticks(joint.calibrations[0].id))

    def __enter__(self) -> Self:
        self.port.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.port.close()


def mounted_servos(joints: Iterable[Mounting], link_play: float = 0.0) -> SimulatedBus:
    """Return a bus with the servos of joints, each joint at position 0."""
    pairs = [joint.calibrations for joint in joints]
    bus = SimulatedBus([_servo(mount, link_play) for mounts in pairs for mount in mounts])
    for mounts in pairs:
        if len(mounts) == 2:
            one, other = mounts
            bus.couple(one.id, other.id, _turns(one) * _turns(other))
    return bus


def _servo(mount: Mount, link_play: float) -> SimulatedServo:
    """Return a servo that stands at its joint's position 0, with the memory that it needs."""
    model, init = simulated_model(mount.model), mount.init
    if mount.offset and model.is_feetech:
        init = (init + mount.offset) % model.ticks
    elif mount.offset and model.control == "profile":
        init -= mount.offset
    position = 2 * model.center - init if mount.reverse else init
    servo = SimulatedServo(mount.id, mount.model, position=position, link_play=link_play)
    if mount.reverse:
        servo.set_register("Drive Mode", 1)
    if mount.offset:
        servo.set_offset(mount.offset)
    return servo


def _turns(mount: Mount) -> int:
    """Return 1 if the shaft turns counter-clockwise for rising positions, else -1."""
    return -mount.direction if mount.reverse else mount.direction
