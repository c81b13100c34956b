"""One head for each ROS domain and namespace of a machine: two would move each other's servos.

Two files in /tmp are locked while the processes of a head run:

    real   by real heads, which have priority over simulated heads
    head   by the head that publishes

A real head locks `real`, then waits for `head`. A simulated head locks `head`, and releases it when
another head has locked `real`. So a real and a simulated head never run together.
"""

from __future__ import annotations

import ctypes
import fcntl
import getpass
import os
import shlex
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Final

from head_tracking.exceptions import RefusedError
from head_tracking.ros.kit.stop_signal import EndRequestedError

_FOLDER: Final = Path("/tmp")  # not TMPDIR, which may differ between users
_PATIENCE: Final = 15.0  # s that a simulated head may take to end
_PERIOD: Final = 0.05  # s
_RETRIES: Final = (0.002, 0.005, 0.01, 0.02, 0.0)  # s
CURES: Final = (
    "give this one a ROS domain of its own (ROS_DOMAIN_ID) or names of its own "
    "(--ros-args -r __ns:=/second), or let both command one head (--allow-others)"
)


class HeadLock:
    """The lock of one domain and namespace.

    Args:
        arguments: of ROS; they may set the namespace.
        simulated: whether the servos are simulated.
        folder: of the files.

    Attributes:
        descriptors: of the locked files; a process that inherits them holds the lock, too.
    """

    def __init__(
        self, arguments: Sequence[str], *, simulated: bool, folder: Path = _FOLDER
    ) -> None:
        self._namespace = namespace(arguments)
        name = f"head_tracking_{domain_and_namespace(arguments)}"
        self._real = folder / f"{name}.real.lock"
        self._head = folder / f"{name}.head.lock"
        self._simulated = simulated
        self.descriptors: list[int] = []

    def acquire(
        self,
        wait: Callable[[float], object] = time.sleep,
        *,
        shared: bool = False,
        patience: float = _PATIENCE,
    ) -> None:
        """Lock; a real head waits until a simulated one has ended.

        Args:
            wait: waits for a time [s]; returns True to give up.
            shared: together with other heads that share.
            patience: how long to wait for a simulated head [s].

        Raises:
            RefusedError: another head runs.
            EndRequestedError: `wait` has returned True.
        """
        if self._simulated:
            self._lock(self._head, shared)
            if self.is_wanted:
                self.release()
                raise self._refusal(self._real)
            return
        self._lock(self._real, shared)
        deadline = time.monotonic() + patience
        while True:
            try:
                return self._lock(self._head, shared)
            except RefusedError:
                if time.monotonic() > deadline:
                    raise
            if wait(_PERIOD):
                raise EndRequestedError

    @property
    def is_wanted(self) -> bool:
        """Whether a simulated head must end, because a real one runs or waits for it."""
        if not (self._simulated and self.descriptors):
            return False
        file = _open(self._real)
        try:
            return not _flock(file, fcntl.LOCK_EX)
        finally:
            os.close(file)

    @property
    def reason(self) -> str:
        """Why a simulated head must end."""
        return str(self._refusal(self._real))

    def release(self) -> None:
        """Unlock."""
        while self.descriptors:
            os.close(self.descriptors.pop())

    def _lock(self, path: Path, shared: bool) -> None:
        file = _open(path)
        kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
        for pause in _RETRIES:  # a simulated head that tests `real` locks it for a moment
            if _flock(file, kind):
                break
            time.sleep(pause)
        else:
            os.close(file)
            raise self._refusal(path)
        self.descriptors.append(file)
        with suppress(OSError):  # the file of another user may be read-only
            os.ftruncate(file, 0)
            os.pwrite(file, _myself().encode(), 0)

    def _refusal(self, path: Path) -> RefusedError:
        holder = path.read_text(errors="replace") or "it has just started"
        head = f"{self._namespace.rstrip('/')}/servo_bus"
        return RefusedError(f"another head is on this machine: {head} ({holder}); {CURES}")


def namespace(arguments: Sequence[str]) -> str:
    """Return the namespace that arguments of ROS give to all nodes, such as /second, or /."""
    return "/" + _renamed(arguments, ("__ns",), "").strip("/")


def node_name(arguments: Sequence[str], usual: str) -> str:
    """Return the name that arguments of ROS give to all nodes of a program."""
    return _renamed(arguments, ("__node", "__name"), usual)


def _renamed(arguments: Sequence[str], what: tuple[str, ...], usual: str) -> str:
    rules = [rule for word, rule in pairwise(arguments) if word in ("-r", "--remap")]
    given = [name for rule, _, name in (rule.partition(":=") for rule in rules) if rule in what]
    return given[0] if given else usual  # ROS uses the first rule


def domain_and_namespace(arguments: Sequence[str]) -> str:
    """Return domain and namespace as part of a file name, such as `0.second`."""
    text = os.environ.get("ROS_DOMAIN_ID", "")
    domain = ctypes.CDLL(None).strtoul(os.fsencode(text), None, 0)  # as ROS does: 07 is 7
    return f"{domain}{namespace(arguments).rstrip('/').replace('/', '.')}"


def _flock(file: int, kind: int) -> bool:
    """Lock a file and return whether that succeeded at once."""
    try:
        fcntl.flock(file, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _open(path: Path) -> int:
    """Open a file that all users of the machine lock."""
    problems: dict[str | None, None] = {}
    for flags in (os.O_RDWR, os.O_RDWR | os.O_CREAT | os.O_EXCL, os.O_RDONLY):
        try:
            file = os.open(path, flags | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
        except OSError as error:
            problems[error.strerror] = None
            continue
        with suppress(OSError):
            os.fchmod(file, 0o666)  # whatever the umask
        return file
    raise RefusedError(
        f"the lock of this head, {path}, cannot be opened ({', '.join(map(str, problems))}); "
        "make its folder writable, or delete the file"
    )


def _myself() -> str:
    command = shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])[:200]
    try:
        user = getpass.getuser()
    except (OSError, KeyError):
        user = str(os.getuid())
    return f"process {os.getpid()} of {user}: {command}"
