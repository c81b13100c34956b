"""The real port on a pty, and the latency timer and the name of its adapter."""

import errno
import os
import threading
import tty
from pathlib import Path
from types import SimpleNamespace

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
from head_tracking.dynamixel.adapter import Adapter, prepare_adapter, stable_name
from head_tracking.dynamixel.exceptions import (
    BaudRateError,
    NotConnectedError,
    PortMissingError,
    PortPermissionError,
)
from head_tracking.dynamixel.serial_port import LinuxDevice, SerialDevice, port_error, serial_ports


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
def peer():
    p = Peer()
    yield p
    p.close()


@pytest.fixture(params=[LinuxDevice, SerialDevice])
def port(peer, request):
    # Patient, because the other end is a thread on a machine that may be busy.
    p = DynamixelPort(peer.name, reply_timeout=5.0, open_device=request.param)
    p.open()
    yield p
    p.close()


def test_port_that_takes_no_data_is_lost(port):
    with pytest.raises(PortLostError):
        for _ in range(10_000):  # nobody reads the other end
            port.sync_write(30, {servo_id: bytes(4) for servo_id in range(40)})
    assert not port.is_open


@pytest.mark.parametrize("after", [0, 8], ids=["before", "while waiting"])
def test_port_that_vanishes_is_lost(peer, port, after):
    thread = threading.Thread(target=peer.vanish, args=(after,))
    thread.start()
    if not after:
        join(thread)
    with pytest.raises(PortLostError):
        port.read(1, 36, 2)
    join(thread)
    assert not port.is_open
    with pytest.raises(PortLostError):
        port.ping(1)
    port.close()
    with pytest.raises(NotConnectedError):
        port.ping(1)


def test_missing_port_lists_what_exists(monkeypatch):
    monkeypatch.setattr(port_module, "serial_ports", lambda: ("/dev/ttyUSB0", "/dev/ttyACM0"))
    with pytest.raises(PortMissingError, match="/dev/ttyUSB0, /dev/ttyACM0"):
        DynamixelPort("/dev/ttyNone").open()


def test_forbidden_port_names_the_group(peer):
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


def test_file_is_no_port():
    with pytest.raises(PortError):
        DynamixelPort("/etc/passwd").open()
    for_others = port_error("/etc/passwd", OSError(errno.EACCES, ""))
    assert "must be a serial device" in str(for_others)


def test_port_that_cannot_do_the_baud_rate_says_so(peer, monkeypatch):
    def refuse(*_, **__):
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
def test_a_rate_that_no_servo_knows_and_a_senseless_timeout_are_refused(options):
    with pytest.raises(ConfigurationError):
        DynamixelPort("/dev/ttyUSB0", **options)


def test_opening_and_failing_leaves_no_descriptor(peer):
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


# The adapter's latency timer: set where there is one, reported, tolerated where there is none


class Kernel:
    """A sysfs with one adapter.

    Args:
        root: a directory.
        latency: what its latency timer says; None: it has none.
    """

    def __init__(self, root: Path, latency: str | None) -> None:
        self.root = root
        self.device = root / "class" / "tty" / "ttyUSB0" / "device"
        self.device.mkdir(parents=True)
        (root / "ftdi_sio").mkdir()
        os.symlink(root / "ftdi_sio", self.device / "driver")
        self.timer = self.device / "latency_timer"
        if latency is not None:
            self.timer.write_text(latency)
        self.asked = 0

    def low_latency(self) -> None:
        self.asked += 1
        self.timer.write_text("1\n")

    def refuse(self) -> None:
        self.asked += 1
        raise OSError(errno.ENOTTY, "no such knob")


@pytest.mark.parametrize("by_link", [False, True])
@pytest.mark.parametrize(
    ("before", "refused", "asked"),
    [("16\n", False, 1), ("16\n", True, 1), ("1\n", True, 0)]
    + [(no_timer, True, 1) for no_timer in (None, "", "soon\n")],
)
def test_timer_of_an_ftdi_adapter_is_set_by_the_driver_or_by_sysfs_where_there_is_one(
    tmp_path, before, refused, asked, by_link
):
    kernel, link = Kernel(tmp_path / "sys", before), tmp_path / "by-id"
    os.symlink("/dev/ttyUSB0", link)
    request = kernel.refuse if refused else kernel.low_latency
    adapter = prepare_adapter(str(link) if by_link else "/dev/ttyUSB0", request, kernel.root)
    has_timer = before in ("16\n", "1\n")
    assert adapter == Adapter("ftdi_sio", 0.001 if has_timer else None)
    assert str(adapter).endswith(", latency timer 1 ms" if has_timer else ", no latency timer")
    assert not has_timer or kernel.timer.read_text() == "1\n"
    assert kernel.asked == asked


def test_timer_that_may_not_be_set_is_reported_with_the_remedy(tmp_path, monkeypatch):
    kernel = Kernel(tmp_path, "16\n")

    def refused(path, text):
        raise PermissionError(errno.EACCES, "not yours")

    monkeypatch.setattr(Path, "write_text", refused)
    adapter = prepare_adapter("/dev/ttyUSB0", kernel.refuse, kernel.root)
    assert adapter.latency == 0.016
    for word in ("16 ms", "sudo tee", "head_setup udev"):
        assert word in adapter.advice


def test_device_is_found_by_its_serial_number(tmp_path):
    folder = tmp_path / "by-id"
    folder.mkdir()
    device = tmp_path / "ttyUSB0"
    device.touch()
    os.symlink(tmp_path / "ttyUSB9", folder / "another")
    os.symlink(device, folder / "usb-FTDI_1234")

    def found(name, folder=folder, serial_number="1234"):
        return stable_name(str(tmp_path / name), folder, lambda _: serial_number)

    assert found("ttyUSB0") == str(folder / "usb-FTDI_1234")
    assert found("ttyUSB1") == ""
    assert found("ttyUSB0", tmp_path / "nowhere") == ""
    assert found("ttyUSB0", serial_number=None) == ""  # another adapter may have the same link


def test_adapters_that_changed_their_names_are_opened_by_serial_number(monkeypatch):
    adapters = {"/dev/ttyUSB0": "A", "/dev/ttyUSB1": "B"}
    opened = []

    def by_serial_number(name):
        return f"/dev/serial/by-id/{adapters[name]}" if name in adapters else ""

    def open_device(name, baud_rate):
        names = adapters | {by_serial_number(device): each for device, each in adapters.items()}
        if name not in names:
            raise PortMissingError(name, [])
        opened.append(names[name])
        return SimpleNamespace(adapter=Adapter(), close=lambda: None)

    monkeypatch.setattr(port_module, "stable_name", by_serial_number)
    ports = [DynamixelPort(name, open_device=open_device) for name in adapters]
    for _ in range(2):
        for port in ports:
            port.open()
            port.close()
        adapters = {"/dev/ttyUSB0": "B", "/dev/ttyUSB1": "A"}  # after a USB reset
    assert opened == ["A", "B", "A", "B"]
    adapters = {"/dev/ttyUSB0": "B"}
    with pytest.raises(PortMissingError):
        ports[0].open()
