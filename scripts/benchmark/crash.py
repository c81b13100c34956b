"""Killed processes of a run, and a simulated run beside a real head."""

from __future__ import annotations

import os
import random
import signal
import statistics
import tempfile
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from frame import report, row, table
from processes import child
from rig import Bench, Program

KILLS = 50  # of each process
TRIES = 200
_SLICE = 0.001  # s


def killed(count: float = KILLS) -> str:
    """Return the table of SIGKILL of each process at random moments while the head moves."""
    rows = []
    for name in ("control", "supervisor"):
        times = [_torque_off_after(name, seed) for seed in range(round(count))]
        off = f"{1e3 * statistics.median(times):.0f} ms, {1e3 * max(times):.0f} ms"
        rows.append(row(name, len(times), off, "300 ms"))
    for name in ("vision", "page"):
        times = [_again_after(name, seed) for seed in range(round(count / 2))]
        again = f"{statistics.median(times):.1f} s, {max(times):.1f} s"
        rows.append(row(f"{name}, restarted while the head continues", len(times), again, ""))
    return table("killed | times | torque off or restarted: median, largest | limit", rows)


def _torque_off_after(name: str, seed: int) -> float:
    """Return the time from SIGKILL until both servos are relaxed [s]."""
    with tempfile.TemporaryDirectory() as folder, closing(Bench(Path(folder))) as bench:
        run = bench.run("--target", "smooth")
        _wait(lambda: bench.servos.torque == [1, 1])
        time.sleep(random.Random(seed).uniform(0.0, 0.5))
        pid = run.process.pid if name == "supervisor" else child(run, name)
        start = time.monotonic()
        os.kill(pid, signal.SIGKILL)
        _wait(lambda: bench.servos.torque == [0, 0])
        return time.monotonic() - start


def _again_after(name: str, seed: int) -> float:
    """Return the time from SIGKILL until the process runs again [s]."""
    with tempfile.TemporaryDirectory() as folder, closing(Bench(Path(folder))) as bench:
        ros = ("-p", "viewer:port:=0")
        run = bench.run("--target", "face" if name == "vision" else "smooth", "--viewer", ros=ros)
        pid = _wait(lambda: child(run, name))
        if name == "page":
            _wait(lambda: bench.servos.torque == [1, 1])
        time.sleep(2.0 + random.Random(seed).uniform(0.0, 1.0))
        start = time.monotonic()
        control, before = child(run, "control"), bench.servos.torque
        os.kill(pid, signal.SIGKILL)
        _wait(lambda: child(run, name) not in (0, pid))
        assert (child(run, "control"), bench.servos.torque) == (control, before), run.output
        return time.monotonic() - start


def beside(tries: float = TRIES) -> str:
    """Return the table of simulated runs started before, after and with a real head."""
    orders = ("the real head first", "the simulated run first", "at once")
    moved = dict.fromkeys(orders, 0)
    count = dict.fromkeys(orders, 0)
    for seed in range(round(tries)):
        order = orders[seed % 3]
        count[order] += 1
        if _moves_a_real_head(order, random.Random(seed)):
            moved[order] += 1
            report(f"moved: {order} {seed}")
    rows = [row(order, count[order], moved[order], 0) for order in orders]
    return table("order | tries | torque or motion of a real servo | limit", rows)


def _moves_a_real_head(order: str, rnd: random.Random) -> bool:
    """Return whether a simulated run has switched torque on or moved real servos."""
    with tempfile.TemporaryDirectory() as folder, closing(Bench(Path(folder))) as bench:
        start: tuple[Callable[[], Program], ...] = (
            lambda: bench.run("--target", "none"),
            lambda: bench.start("head_tracking", "--sim"),
        )
        gap = {"at once": rnd.uniform(0.0, 0.4)}.get(order, rnd.uniform(1.0, 2.5))
        first = order == "the simulated run first" or (order == "at once" and rnd.random() < 0.5)
        bench.servos.true  # noqa: B018  makes the port before the programs start
        for begin in start[::-1] if first else start:
            begin()
            time.sleep(gap)
        end = time.monotonic() + 3.0
        while time.monotonic() < end:
            if bench.servos.torque != [0, 0] or max(map(abs, bench.servos.true)) > 1e-3:
                return True
            time.sleep(0.01)
        return False


def _wait(condition: Callable[[], int]) -> int:
    end = time.monotonic() + 60.0
    while not (found := condition()):
        if time.monotonic() > end:
            raise SystemExit("no result within 60 s")
        time.sleep(_SLICE)
    return found
