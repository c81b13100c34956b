"""A simulated run with a page, and the figures of processes."""

import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from rig import Bench, Program


@contextmanager
def own_bench() -> Iterator[Bench]:
    """Yield a ROS domain of its own, with a folder for files."""
    with tempfile.TemporaryDirectory() as folder, closing(Bench(Path(folder))) as bench:
        yield bench


@contextmanager
def run_with_page(*arguments: str) -> Iterator[tuple[Program, int]]:
    """Start `head_tracking --sim --viewer` in a ROS domain of its own; yield it and its port."""
    with own_bench() as bench:
        ros = ("--ros-args", "-p", "viewer:port:=0")
        run = bench.start("head_tracking", "--sim", "--viewer", *arguments, *ros)
        found = re.search(r"http://\S+:(\d+)", run.read_until("the robot is at http"))
        assert found is not None
        yield run, int(found[1])


def descendants(pid: int) -> Iterator[int]:
    """Yield the process ids of all children, their children, and so on."""
    for children in Path(f"/proc/{pid}/task").glob("*/children"):
        with suppress(OSError):  # the thread has just ended
            for child in map(int, children.read_text().split()):
                yield child
                yield from descendants(child)


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
