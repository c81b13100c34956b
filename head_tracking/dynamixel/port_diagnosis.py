"""Says why a serial port cannot be opened, and what to do about it."""

from __future__ import annotations

import errno
import grp
import os
from collections.abc import Sequence

from head_tracking.dynamixel.exceptions import (
    PortBusyError,
    PortError,
    PortMissingError,
    PortPermissionError,
)


def port_error(port_name: str, cause: Exception, existing: Sequence[str]) -> PortError:
    """Return the error to raise.

    Args:
        port_name: The device that was to be opened.
        cause: What the operating system said; its first argument is the error number. Or pyserial's
            ValueError, of a device that does not know the baud rate.
        existing: Serial devices of this machine.
    """
    if isinstance(cause, ValueError):
        return PortError(port_name, f"it cannot do this baud rate: {cause}")
    number = cause.args[0] if cause.args else None
    if number == errno.ENOENT:
        return PortMissingError(port_name, existing)
    if number in (errno.EBUSY, errno.EAGAIN):
        return PortBusyError(port_name)
    if number in (errno.EACCES, errno.EPERM):
        return PortPermissionError(port_name, _group_of(port_name))
    return PortError(port_name, f"{cause}; it must be a serial device")


def _group_of(port_name: str) -> str:
    try:
        return grp.getgrgid(os.stat(port_name).st_gid).gr_name
    except (OSError, KeyError):
        return "dialout"
