"""A simulated run in a process of its own, its status lines, and the figures of processes."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, Self

from processes import child

PATIENCE = 60.0


class Status(NamedTuple):
    """A status line.

    Attributes:
        error: angle between the camera and the target [degrees].
        rate: bus cycles in the last second.
    """

    error: float
    rate: int


class SimulatedRun:
    """`head_tracking --sim` with more arguments, as a context manager.

    Attributes:
        process: the supervisor.
        port: of its page; 0 without `--viewer`.
        statuses: every status line since it was ready, the latest last.
    """

    def __init__(self, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-u", "-m", "head_tracking", "--sim", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._shown = "--viewer" in arguments
        self._ready = threading.Event()
        self._reader = threading.Thread(target=self._read)
        self.port = 0
        self.statuses: list[Status] = []

    @property
    def viewer_pid(self) -> int:
        """Process id of the page."""
        return child(self, "page")

    @property
    def control_pid(self) -> int:
        """Process id of control."""
        return child(self, "control")

    def __enter__(self) -> Self:
        self._reader.start()
        if not self._ready.wait(PATIENCE):
            self.__exit__()
            raise SystemExit(f"the simulated head is not ready within {PATIENCE:g} s")
        return self

    def __exit__(self, *_: object) -> None:
        self.process.terminate()
        self.process.wait()
        self._reader.join()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if found := re.search(r"the robot is at http://\S+:(\d+)", line):
                self.port = int(found[1])
            if found := re.search(r"error +([\d.]+)°.*\| bus (\d+) Hz", line):
                self.statuses.append(Status(float(found[1]), int(found[2])))
                if self.port or not self._shown:
                    self._ready.set()


def own_domain() -> None:
    """Use an own ROS domain in this process and its children."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)


def descendants(pid: int) -> Iterator[int]:
    """Yield the process ids of all children, their children, and so on."""
    parents = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue  # it has just ended
        parents.setdefault(int(fields[1]), []).append(int(folder.name))
    pending = [pid]
    while pending:
        found = parents.get(pending.pop(), [])
        yield from found
        pending.extend(found)


def command(pid: int) -> bytes:
    """Return the command line of a process; empty if it has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def processor_time(pid: int) -> float:
    """Return the processor time of a process [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def memory(pid: int) -> float:
    """Return the resident memory of a process [MB]."""
    text = Path(f"/proc/{pid}/status").read_text()
    return int(text.split("VmRSS:")[1].split()[0]) / 1024.0


def threads(pid: int) -> int:
    """Return the number of threads of a process."""
    return len(os.listdir(f"/proc/{pid}/task"))


def file_descriptors(pid: int) -> int:
    """Return the number of open file descriptors of a process."""
    return len(os.listdir(f"/proc/{pid}/fd"))
