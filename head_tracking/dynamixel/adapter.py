"""The serial adapter: which driver serves it, and how long it keeps received bytes to itself.

FTDI chips keep short packets for the time of their latency timer, 16 ms from the factory, so
that each answer of a servo takes that long. Sources: Linux ftdi_sio, and the fact sheet's section
on adapters.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

_WANTED: Final = 1  # ms


@dataclass(frozen=True, slots=True)
class Adapter:
    """What is known about a serial adapter.

    Attributes:
        driver: Kernel driver, such as ftdi_sio; empty if it is not known.
        latency: How long it may keep received bytes to itself, s; None where it has no such knob.
        advice: What to do about a latency that is too long; empty if all is well.
    """

    driver: str = ""
    latency: float | None = None
    advice: str = ""

    def __str__(self) -> str:
        name = self.driver or "serial adapter"
        if self.latency is None:
            return f"{name}, no latency timer"
        return f"{name}, latency timer {self.latency * 1e3:.0f} ms"


def stable_name(port_name: str, folder: Path = Path("/dev/serial/by-id")) -> str:
    """Return the name by which a device is found again wherever it is plugged in; "" if none.

    Args:
        port_name: The device, such as /dev/ttyUSB0.
        folder: Where udev keeps links by serial number.
    """
    device = os.path.realpath(port_name)
    with suppress(OSError):
        for link in sorted(folder.iterdir()):
            if os.path.realpath(link) == device:
                return str(link)
    return ""


def prepare_adapter(
    port_name: str, set_low_latency: Callable[[], object], sysfs: Path = Path("/sys")
) -> Adapter:
    """Set the shortest latency where there is such a setting, and return what is known then.

    Args:
        port_name: The device, or a link to it.
        set_low_latency: Asks the driver to deliver received bytes at once; raises OSError or
            ValueError where that cannot be done.
        sysfs: Where the kernel shows its devices.
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
    if before is None:
        return Adapter(driver)
    if (_latency(timer) or 0) > _WANTED:
        with suppress(OSError):
            timer.write_text(f"{_WANTED}\n")
    latency = _latency(timer)
    if latency is None:
        return Adapter(driver)
    advice = _advice(latency, timer) if latency > _WANTED else ""
    return Adapter(driver, latency * 1e-3, advice)


def _latency(timer: Path) -> int | None:
    try:
        return int(timer.read_text())
    except (OSError, ValueError):
        return None


def _advice(latency: int, timer: Path) -> str:
    return (
        f"each answer of a servo takes up to {latency} ms, because the adapter's latency timer "
        f"could not be set to {_WANTED} ms. Until it is unplugged: "
        f"`echo {_WANTED} | sudo tee {timer}`; for good: `ros2 run head_tracking head_setup udev`, "
        "and plug it in again"
    )
