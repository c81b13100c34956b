"""Killed processes of a run."""

import os
import random
import signal
import statistics
import time

from frame import row, table
from rig import child
from simulated_run import own_bench
from waiting import wait_for


def killed(count: int) -> str:
    """Return the table of SIGKILL of each process at random moments while the head moves."""
    rows = []
    for name in ("control", "supervisor"):
        times = [_torque_off_after(name, seed) for seed in range(count)]
        off = f"{1e3 * statistics.median(times):.0f} ms, {1e3 * max(times):.0f} ms"
        rows.append(row(name, len(times), off, "300 ms"))
    for name in ("vision", "page"):
        times = [_again_after(name, seed) for seed in range(count // 2)]
        again = f"{statistics.median(times):.1f} s, {max(times):.1f} s"
        rows.append(row(f"{name}, restarted while the head continues", len(times), again, ""))
    return table("killed | times | torque off or restarted: median, largest | limit", rows)


def _torque_off_after(name: str, seed: int) -> float:
    """Return the time from SIGKILL until both servos are relaxed [s]."""
    with own_bench() as bench:
        run = bench.run("--target", "smooth")
        wait_for(lambda: bench.servos.torque == [1, 1])
        time.sleep(random.Random(seed).uniform(0.0, 0.5))
        pid = run.process.pid if name == "supervisor" else child(run.process.pid, name)
        start = time.monotonic()
        os.kill(pid, signal.SIGKILL)
        wait_for(lambda: bench.servos.torque == [0, 0], interval=0.001)
        return time.monotonic() - start


def _again_after(name: str, seed: int) -> float:
    """Return the time from SIGKILL until the process runs again [s]."""
    with own_bench() as bench:
        ros = ("-p", "viewer:port:=0")
        run = bench.run("--target", "face" if name == "vision" else "smooth", "--viewer", ros=ros)
        pid = wait_for(lambda: child(run.process.pid, name))
        if name == "page":
            wait_for(lambda: bench.servos.torque == [1, 1])
        time.sleep(2.0 + random.Random(seed).uniform(0.0, 1.0))
        start = time.monotonic()
        control, before = child(run.process.pid, "control"), bench.servos.torque
        os.kill(pid, signal.SIGKILL)
        wait_for(lambda: child(run.process.pid, name) not in (0, pid), interval=0.001)
        assert child(run.process.pid, "control") == control, run.output
        assert bench.servos.torque == before, run.output
        return time.monotonic() - start
