"""The real port on a pty: exact bytes out, all kinds of bytes back."""

from __future__ import annotations

import errno
import os
import threading
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import serial
from waiting import join

from head_tracking.dynamixel import (
    ConfigurationError,
    DynamixelPort,
    PortBusyError,
    PortError,
    PortLostError,
    ReplyTimeoutError,
)
from head_tracking.dynamixel import port as port_module
from head_tracking.dynamixel.exceptions import (
    BaudRateError,
    NotConnectedError,
    PortMissingError,
    PortPermissionError,
)
from head_tracking.dynamixel.serial_port import (
    LinuxDevice,
    SerialDevice,
    port_error,
    serial_ports,
)


class Peer:
    """The other end of a pty."""

    def __init__(self) -> None:
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.name = os.ttyname(self.slave)

    def vanish(self, after: int = 0) -> None:
        """Close both ends, once so many bytes have come."""
        while after > 0:
            after -= len(os.read(self.master, after))
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


@pytest.fixture(params=[LinuxDevice, SerialDevice])
def port(peer: Peer, request: pytest.FixtureRequest) -> Iterator[DynamixelPort]:
    # Patient, because the other end is a thread on a machine that may be busy.
    p = DynamixelPort(peer.name, reply_timeout=5.0, open_device=request.param)
    p.open()
    yield p
    p.close()


def test_port_that_takes_no_data_is_lost(port: DynamixelPort) -> None:
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
    thread = threading.Thread(target=peer.vanish, args=(8,))
    thread.start()
    with pytest.raises(PortLostError):
        port.read(1, 36, 2)
    join(thread)


def test_missing_port_lists_what_exists(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(port_module, "serial_ports", lambda: ("/dev/ttyUSB0", "/dev/ttyACM0"))
    with pytest.raises(PortMissingError, match="/dev/ttyUSB0, /dev/ttyACM0"):
        DynamixelPort("/dev/ttyNone").open()


def test_forbidden_port_names_the_group(peer: Peer) -> None:
    serial_ports(), Path("/").group()  # what these import must be there before the rights go
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
    with pytest.raises(BaudRateError):
        port.open()
    assert not port.is_open
    assert len(os.listdir("/proc/self/fd")) == before


@pytest.mark.parametrize(
    "options",
    [
        *({"baud_rate": rate} for rate in (0, 117_600)),
        *({"reply_timeout": seconds} for seconds in (0.0, -1.0, float("nan"), 100.0)),
    ],
)
def test_a_rate_that_no_servo_knows_and_a_senseless_timeout_are_refused(
    options: dict[str, Any],
) -> None:
    with pytest.raises(ConfigurationError):
        DynamixelPort("/dev/ttyUSB0", **options)


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
