"""The adapter's latency timer: set where there is one, reported, tolerated where there is none."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from head_tracking.dynamixel import DynamixelPort
from head_tracking.dynamixel import port as port_module
from head_tracking.dynamixel.adapter import Adapter, prepare_adapter, stable_name
from head_tracking.dynamixel.exceptions import PortMissingError


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


@pytest.mark.parametrize(
    ("before", "refused", "asked"), [("16\n", False, 1), ("16\n", True, 1), ("1\n", True, 0)]
)
def test_timer_of_an_ftdi_adapter_is_set_by_the_driver_or_by_sysfs(
    tmp_path: Path, before: str, refused: bool, asked: int
) -> None:
    kernel = Kernel(tmp_path, before)
    request = kernel.refuse if refused else kernel.low_latency
    adapter = prepare_adapter("/dev/ttyUSB0", request, kernel.root)
    assert adapter == Adapter("ftdi_sio", 0.001)
    assert str(adapter) == "ftdi_sio, latency timer 1 ms"
    assert kernel.timer.read_text() == "1\n"
    assert kernel.asked == asked


def test_timer_that_may_not_be_set_is_reported_with_the_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kernel = Kernel(tmp_path, "16\n")

    def refused(path: Path, text: str) -> int:
        raise PermissionError(errno.EACCES, "not yours")

    monkeypatch.setattr(Path, "write_text", refused)
    adapter = prepare_adapter("/dev/ttyUSB0", kernel.refuse, kernel.root)
    assert adapter.latency == 0.016
    for word in ("16 ms", "sudo tee", "head_setup udev"):
        assert word in adapter.advice


@pytest.mark.parametrize("content", [None, "", "soon\n", "1\n"])
def test_adapter_is_known_also_by_a_link_and_without_a_timer(
    tmp_path: Path, content: str | None
) -> None:
    kernel = Kernel(tmp_path / "sys", content)
    link = tmp_path / "by-id"
    os.symlink("/dev/ttyUSB0", link)
    adapter = prepare_adapter(str(link), kernel.refuse, kernel.root)
    assert adapter == Adapter("ftdi_sio", 0.001 if content == "1\n" else None)
    assert ("no latency timer" in str(adapter)) == (content != "1\n")


def test_device_is_found_by_its_serial_number(tmp_path: Path) -> None:
    folder = tmp_path / "by-id"
    folder.mkdir()
    device = tmp_path / "ttyUSB0"
    device.touch()
    os.symlink(tmp_path / "ttyUSB9", folder / "another")
    os.symlink(device, folder / "usb-FTDI_1234")

    def found(name: str, folder: Path = folder, serial_number: str | None = "1234") -> str:
        return stable_name(str(tmp_path / name), folder, lambda _: serial_number)

    assert found("ttyUSB0") == str(folder / "usb-FTDI_1234")
    assert found("ttyUSB1") == ""
    assert found("ttyUSB0", tmp_path / "nowhere") == ""
    assert found("ttyUSB0", serial_number=None) == ""  # another adapter may have the same link


def test_adapters_that_changed_their_names_are_opened_by_serial_number(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    adapters = {"/dev/ttyUSB0": "A", "/dev/ttyUSB1": "B"}
    opened: list[str] = []

    def by_serial_number(name: str) -> str:
        return f"/dev/serial/by-id/{adapters[name]}" if name in adapters else ""

    def open_device(name: str, baud_rate: int) -> Any:
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
