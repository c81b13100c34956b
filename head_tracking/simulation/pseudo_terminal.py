"""A pair of pseudo-terminals: the device that a program opens, and the end behind it."""

from __future__ import annotations

import fcntl
import os
import struct
import tty
from contextlib import suppress
from typing import Final

from head_tracking.simulation.exceptions import PortLinkError

_TCGETS2: Final = 0x802C542A
_TERMIOS2: Final = 44  # bytes of struct termios2
_SPEED_OFFSET: Final = 40  # its c_ospeed
_CHUNK: Final = 4096


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
        self.link = link
        try:
            tty.setraw(self._slave)
            os.set_blocking(self.descriptor, False)
            self.name = os.ttyname(self._slave)
            self._make_link()
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
        # Only if the link is still ours: another simulator may have taken the path over.
        with suppress(OSError):
            if self.link is not None and os.readlink(self.link) == self.name:
                os.unlink(self.link)
        self._close()

    def _close(self) -> None:
        os.close(self.descriptor)
        os.close(self._slave)

    def _make_link(self) -> None:
        if self.link is None:
            return
        if os.path.lexists(self.link) and not os.path.islink(self.link):
            raise PortLinkError(
                f"cannot make the link {self.link}: something else has that name; remove it or "
                "choose another path"
            )
        try:
            with suppress(FileNotFoundError):
                os.unlink(self.link)
            os.symlink(self.name, self.link)
        except OSError as cause:
            raise PortLinkError(
                f"cannot make the link {self.link}: {cause.strerror}; choose a path in a "
                "directory you may write to"
            ) from cause
