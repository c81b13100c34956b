"""The servo bus for minutes on a bus that is never well: memory, threads, rates."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

from frame import row, table
from simulated_run import file_descriptors, memory

from head_tracking.dynamixel import (
    BusReading,
    BusThread,
    DynamixelError,
    DynamixelPort,
    Goal,
    JointConfiguration,
    ServoBus,
    Torque,
)
from head_tracking.dynamixel.servo import run

RATE = 50.0
SAMPLES = 5


def soak(minutes: float) -> str:
    """A table with a line for every part of the run."""
    joints = [JointConfiguration(f"joint_{i}", i, controller=f"controller_{i}") for i in (1, 2)]
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        link = Path(folder) / "servos"
        command = [sys.executable, "-m", "head_tracking", "simulated_bus", "--link", str(link)]
        command += ["--faults", "1", "--unplug-every", "30", "--seed", "1"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as servos:
            assert servos.stdout is not None
            servos.stdout.readline()
            read: Counter[str] = Counter()
            driver = ServoBus(DynamixelPort(str(link)), joints)
            _connect(driver)

            def count(reading: BusReading) -> None:
                read["cycles"] += 1
                read["joints"] += len(reading.states)

            thread = BusThread(driver, RATE, count)
            thread.start()
            start, sample_start, processor = time.monotonic(), time.monotonic(), time.process_time()
            for sample in range(SAMPLES + 1):
                while time.monotonic() - start < 5.0 + sample * minutes * 60.0 / SAMPLES:
                    _drive(driver, thread, time.monotonic() - start)
                    time.sleep(0.05)
                now, used = time.monotonic(), time.process_time()
                told = driver.statistics()
                failed = sum(servo.timeouts + servo.corrupt for servo in told.servos)
                rows.append(
                    row(
                        f"{(now - start) / 60:.1f}",
                        f"{memory(os.getpid()):.1f}",
                        threading.active_count(),
                        file_descriptors(os.getpid()),
                        f"{read['cycles'] / (now - sample_start):.1f}",
                        f"{100 * read['joints'] / max(1, len(joints) * read['cycles']):.1f} %",
                        failed,
                        told.port_losses,
                        f"{100 * (used - processor) / (now - sample_start):.1f} % of a core",
                    )
                )
                sample_start, processor = now, used
                read.clear()
            thread.stop()
            assert thread.error is None, thread.error
            servos.terminate()
    return table(
        "minute | memory, MB | threads | file descriptors | cycles per second | joints read | "
        "transactions failed | times unplugged | processor", rows
    )  # fmt: skip


def _connect(driver: ServoBus) -> None:
    for _ in range(20):
        with suppress(DynamixelError):
            driver.connect(allow_missing=True)
            return
        time.sleep(0.5)
    raise TimeoutError("the simulated bus does not answer")


def _drive(driver: ServoBus, thread: BusThread, now: float) -> None:
    """A command as somebody would give it who does not know what the bus goes through."""
    names = [joint.joint_name for joint in driver.joints]
    with suppress(DynamixelError):
        driver.command({name: Goal(0.5 * math.sin(now + i)) for i, name in enumerate(names)})
    if any(driver.joint(name).torque is Torque.OFF_BY_FAULT for name in names):
        with suppress(DynamixelError):
            thread.call(lambda bus: run(bus.recovering())).result(5.0)
