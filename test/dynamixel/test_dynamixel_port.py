"""The real port on a pty: exact bytes out, all kinds of bytes back."""

from __future__ import annotations

import errno
import os
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import serial
from serial.tools import list_ports
from waiting import eventually, join

from head_tracking.dynamixel import (
    CommunicationError,
    ConfigurationError,
    DynamixelPort,
    PortBusyError,
    PortError,
    PortLostError,
    ReplyTimeoutError,
)
from head_tracking.dynamixel import port as port_module
from head_tracking.dynamixel.exceptions import (
    NotConnectedError,
    PortMissingError,
    PortPermissionError,
)
from head_tracking.dynamixel.serial_port import port_error, serial_ports

READ = "FF FF 01 04 02 24 02 D2"
POSITION_512 = "FF FF 01 04 00 00 02 F8"


class Peer:
    """The other end of a pty: for each packet that comes in, says the next line of a script."""

    def __init__(self) -> None:
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.name = os.ttyname(self.slave)
        self.received: list[str] = []
        self._thread: threading.Thread | None = None

    def answer(self, *script: tuple[int, str]) -> None:
        """Answer packets: for each pair, read so many bytes, then say the text."""

        def play() -> None:
            for length, text in script:
                data = b""
                while len(data) < length:
                    data += os.read(self.master, length - len(data))
                self.received.append(data.hex(" ").upper())
                if text:
                    os.write(self.master, bytes.fromhex(text))

        self._thread = threading.Thread(target=play, daemon=True)
        self._thread.start()

    def finish(self) -> list[str]:
        """Return what came in."""
        assert self._thread is not None
        self._thread.join(10.0)
        assert not self._thread.is_alive()
        return self.received

    def vanish(self) -> None:
        os.close(self.master)
        os.close(self.slave)
        self.master = self.slave = -1

    def close(self) -> None:
        for descriptor in (self.master, self.slave):
            if descriptor >= 0:
                os.close(descriptor)


@pytest.fixture
def peer() -> Iterator[Peer]:
    p = Peer()
    yield p
    p.close()


@pytest.fixture
def port(peer: Peer) -> Iterator[DynamixelPort]:
    # Patient, because the other end is a thread on a machine that may be busy.
    p = DynamixelPort(peer.name, reply_timeout=5.0)
    p.open()
    yield p
    p.close()


@pytest.fixture
def hasty(peer: Peer) -> Iterator[DynamixelPort]:
    """For tests in which the answer never comes."""
    p = DynamixelPort(peer.name, reply_timeout=0.02)
    p.open()
    yield p
    p.close()


def test_waiting_costs_hardly_any_processor_time(peer: Peer) -> None:
    """The SDK's own waiting spins for as long as the timeout lasts."""
    port = DynamixelPort(peer.name, reply_timeout=0.5)
    port.open()
    before = time.thread_time()
    with pytest.raises(ReplyTimeoutError):
        port.ping(1)
    assert time.thread_time() - before < 0.25
    port.close()


def test_late_answer_is_not_taken_for_the_next(peer: Peer, hasty: DynamixelPort) -> None:
    late = "FF FF 01 04 00 FF 03 F8"  # position 1023
    with pytest.raises(ReplyTimeoutError):
        hasty.read(1, 36, 2)
    assert os.read(peer.master, 100) == bytes.fromhex(READ)
    peer.answer((8, f"{late} FF FF 01 05 00 FF 00 02 F8"))
    with suppress(ReplyTimeoutError):  # a busy machine
        assert hasty.read(1, 36, 2).data == b"\x00\x02"
    assert peer.finish() == ["FF FF 01 04 02 23 03 D2"]


def test_old_bytes_are_not_taken_for_the_answer(peer: Peer, port: DynamixelPort) -> None:
    os.write(peer.master, bytes.fromhex("FF FF 01 04 00 FF 03 F8"))  # late: position 1023
    assert eventually(lambda: _waiting(peer) >= 8)
    peer.answer((8, POSITION_512))
    assert port.read(1, 36, 2).data == b"\x00\x02"


def test_endless_babble_ends_with_the_timeout(peer: Peer, hasty: DynamixelPort) -> None:
    stop = threading.Event()

    def babble() -> None:
        os.set_blocking(peer.master, False)
        while not stop.is_set():
            try:
                os.write(peer.master, bytes(200))
            except BlockingIOError:
                time.sleep(0.001)

    thread = threading.Thread(target=babble, daemon=True)
    thread.start()
    with pytest.raises(CommunicationError):
        hasty.read(1, 36, 2)
    stop.set()
    thread.join(10.0)


def test_port_that_takes_no_data_is_lost(peer: Peer) -> None:
    port = DynamixelPort(peer.name)
    port.open()
    with pytest.raises(PortLostError):
        for _ in range(10_000):  # nobody reads the other end
            port.sync_write(30, {servo_id: bytes(4) for servo_id in range(40)})
    assert not port.is_open


def test_vanished_port_is_lost(peer: Peer, port: DynamixelPort) -> None:
    peer.vanish()
    with pytest.raises(PortLostError):
        port.read(1, 36, 2)
    assert not port.is_open
    with pytest.raises(NotConnectedError):
        port.ping(1)
    port.close()


def test_port_that_vanishes_while_waiting_is_lost(peer: Peer, port: DynamixelPort) -> None:
    peer.answer((8, ""))

    def unplug() -> None:
        peer.finish()
        peer.vanish()

    thread = threading.Thread(target=unplug)
    thread.start()
    with pytest.raises(PortLostError):
        port.read(1, 36, 2)
    join(thread)


def test_sync_write_wants_equal_shares_and_nothing_sends_nothing(port: DynamixelPort) -> None:
    with pytest.raises(CommunicationError):
        port.sync_write(30, {1: b"\x00", 2: b"\x00\x00"})
    port.sync_write(30, {})


def test_missing_port_lists_what_exists(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(port_module, "serial_ports", lambda: ("/dev/ttyUSB0", "/dev/ttyACM0"))
    with pytest.raises(PortMissingError, match="/dev/ttyUSB0, /dev/ttyACM0"):
        DynamixelPort("/dev/ttyNone").open()


def test_a_port_that_has_gone_is_looked_for_without_listing_the_others(
    peer: Peer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    link = tmp_path / "servos"
    link.symlink_to(peer.name)
    port = DynamixelPort(str(link))
    port.open()
    port.close()
    link.unlink()
    listed: list[object] = []

    def comports() -> list[object]:
        listed.append(None)
        return []

    monkeypatch.setattr(list_ports, "comports", comports)
    with pytest.raises(PortMissingError):
        port.open()
    assert not listed


def test_forbidden_port_names_the_group(peer: Peer) -> None:
    serial_ports()  # what this imports must be there before the rights go
    os.chmod(peer.name, 0)
    root = os.geteuid() == 0
    if root:
        os.seteuid(65534)  # root may open anything
    try:
        with pytest.raises(PortPermissionError):
            DynamixelPort(peer.name).open()
    finally:
        if root:
            os.seteuid(0)


def test_file_is_no_port() -> None:
    with pytest.raises(PortError):
        DynamixelPort("/etc/passwd").open()
    for_others = port_error("/etc/passwd", OSError(errno.EACCES, ""))
    assert "must be a serial device" in str(for_others)


def test_port_that_cannot_do_the_baud_rate_says_so(
    peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise ValueError("Failed to set custom baud rate (3000000): [Errno 22]")  # as pyserial does

    monkeypatch.setattr(serial.Serial, "_reconfigure_port", refuse)
    port = DynamixelPort(peer.name, 3_000_000)
    before = len(os.listdir("/proc/self/fd"))
    with pytest.raises(PortError):
        port.open()
    assert not port.is_open
    assert len(os.listdir("/proc/self/fd")) == before


@pytest.mark.parametrize("baud_rate", [0, 117_600, 1_000_001])
def test_baud_rate_that_no_servo_knows_lists_the_others(baud_rate: int) -> None:
    with pytest.raises(ConfigurationError, match=f"{baud_rate} baud; allowed are 9600, .*1000000"):
        DynamixelPort("/dev/ttyUSB0", baud_rate)


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), 100.0])
def test_senseless_timeout_is_refused(value: float) -> None:
    with pytest.raises(ConfigurationError, match="reply_timeout"):
        DynamixelPort("/dev/ttyUSB0", reply_timeout=value)


def test_opening_and_failing_leaves_no_descriptor(peer: Peer) -> None:
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(3):
        port = DynamixelPort(peer.name, reply_timeout=0.001)
        port.open()
        with pytest.raises(PortBusyError):
            DynamixelPort(peer.name).open()
        with pytest.raises(ReplyTimeoutError):
            port.ping(1)
        port.close()
    assert len(os.listdir("/proc/self/fd")) == before


def _waiting(peer: Peer) -> int:
    import array
    import fcntl
    import termios

    count = array.array("i", [0])
    fcntl.ioctl(peer.slave, termios.FIONREAD, count)
    return count[0]
