"""The USB serial adapter: its driver, its latency and its stable name.

FTDI chips hold short packets back for the time of their latency timer, 16 ms by default.
Source: Linux ftdi_sio.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from serial.tools.list_ports_linux import SysFS

_WANTED: Final = 1  # ms


@dataclass(frozen=True, slots=True)
class Adapter:
    """Facts about a serial adapter."""

    driver: str = ""  # kernel driver, such as ftdi_sio; empty if it is not known
    # Time for which it may hold received bytes back, s; None: no latency timer.
    latency: float | None = None
    advice: str = ""  # how to shorten a latency that is too long; empty otherwise

    def __str__(self) -> str:
        name = self.driver or "serial adapter"
        if self.latency is None:
            return f"{name}, no latency timer"
        return f"{name}, latency timer {self.latency * 1e3:.0f} ms"


def _serial_number(device: str) -> str | None:
    with suppress(TypeError, ValueError):  # as of one that is being unplugged
        return SysFS(device).serial_number  # type: ignore[no-any-return]
    return None


def stable_name(
    port_name: str,
    folder: Path = Path("/dev/serial/by-id"),
    serial_number: Callable[[str], str | None] = _serial_number,
) -> str:
    """Return the name of a device by its serial number, from udev's links; "" if it has none.

    Adapters of one kind without serial numbers share one link, to any of them.
    """
    device = os.path.realpath(port_name)
    if not serial_number(device):
        return ""
    with suppress(OSError):
        for link in sorted(folder.iterdir()):
            if os.path.realpath(link) == device:
                return str(link)
    return ""


def prepare_adapter(
    port_name: str, set_low_latency: Callable[[], object], sysfs: Path = Path("/sys")
) -> Adapter:
    """Set the shortest latency that the adapter has, and return its facts.

    Args:
        port_name: The device, or a link to it.
        set_low_latency: Asks the driver for low latency; raises OSError or ValueError if it fails.
        sysfs: Mount point of sysfs.
    """
    device = sysfs / "class" / "tty" / os.path.basename(os.path.realpath(port_name)) / "device"
    driver = ""
    with suppress(OSError):
        driver = os.path.basename(os.readlink(device / "driver"))
    timer = device / "latency_timer"
    before = _latency(timer)
    if before is None or before > _WANTED:
        with suppress(OSError, ValueError):
            set_low_latency()
    if before is not None and (_latency(timer) or 0) > _WANTED:
        with suppress(OSError):
            timer.write_text(f"{_WANTED}\n")
    latency = None if before is None else _latency(timer)
    if latency is None:
        return Adapter(driver)
    advice = (
        f"each reply of a servo takes up to {latency} ms, because the adapter's latency timer "
        f"could not be set to {_WANTED} ms. Until it is unplugged: "
        f"`echo {_WANTED} | sudo tee {timer}`; permanently: `head_tracking head_setup "
        "udev`, then plug it in again"
    )
    return Adapter(driver, latency * 1e-3, advice if latency > _WANTED else "")


def _latency(timer: Path) -> int | None:
    try:
        return int(timer.read_text())
    except (OSError, ValueError):
        return None
