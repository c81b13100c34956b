"""The servo bus: time of a cycle, and behaviour with faults.

This driver, dynamixel_sdk and rustypot take turns on one simulated bus in another process, so that
changes in the load of the machine affect all of them.
"""

import gc
import json
import math
import os
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from functools import partial
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

from dynamixel_sdk import GroupSyncWrite, PacketHandler, PortHandler
from frame import in_turns, medians, report, row, table
from servos import elsewhere
from simulated_device import Rig

from head_tracking.dynamixel import (
    DynamixelError,
    DynamixelPort,
    Goal,
    GoalError,
    JointConfiguration,
    ServoBus,
    Torque,
    servo_model,
)
from head_tracking.dynamixel.reading import ReadGroup
from head_tracking.dynamixel.servo import run
from head_tracking.simulation import (
    Fault,
    Faults,
    Overlap,
    SimulatedBus,
    SimulatedServo,
)

TIMED = Path(__file__).parent / "timed_run.py"
WIRE = {0: 620.0, 500: 1620.0}  # us: sync write of 18 bytes, and twice 8 bytes out and 14 back
ROUNDS, LOADED_ROUNDS, CYCLES, WARM_UP = 15, 7, 150, 20
FAULTY_CYCLES, BURST, FAULT_RATE = 100_000, 1000, 0.05
JOINTS = [JointConfiguration(f"joint_{i}", i, controller=f"controller_{i}") for i in (1, 2)]


class Cost(NamedTuple):
    """Duration and processor time of a cycle, us."""

    wall: float
    processor: float


@contextmanager
def ours(port_name: str) -> Iterator[Callable[[int], object]]:
    """`DynamixelPort`: the reads and the sync write, as `ServoBus` uses it."""
    port = DynamixelPort(port_name)
    port.open()
    groups = [ReadGroup(1, 36, 8, (each,)) for each in (1, 2)]

    def cycle(k: int) -> None:
        replies = [*port.read_group(groups[0]), *port.read_group(groups[1])]
        port.sync_write(30, {1: bytes((k & 255, 2, 100, 0)), 2: bytes((k & 255, 1, 100, 0))})
        if any(isinstance(reply, DynamixelError) for reply in replies):
            raise RuntimeError("a servo did not answer")

    try:
        yield cycle
    finally:
        port.close()


@contextmanager
def whole_bus(port_name: str) -> Iterator[Callable[[int], object]]:
    """`ServoBus.step` with a new command in each cycle."""
    bus = ServoBus(DynamixelPort(port_name), JOINTS)
    bus.connect()

    def cycle(k: int) -> None:
        position = 0.001 * (k & 255)
        bus.command({"joint_1": Goal(position, 1.0), "joint_2": Goal(-position, 1.0)})
        reading = bus.step()
        if len(reading.states) != 2:
            raise RuntimeError("a servo did not answer")

    try:
        yield cycle
    finally:
        bus.close()


@contextmanager
def sdk(port_name: str) -> Iterator[Callable[[int], object]]:
    """dynamixel_sdk, used as in its examples."""
    port, packets = PortHandler(port_name), PacketHandler(1.0)
    port.openPort()
    port.setBaudRate(1_000_000)
    writer = GroupSyncWrite(port, packets, 30, 4)

    def cycle(k: int) -> None:
        writer.clearParam()
        writer.addParam(1, [k & 255, 2, 100, 0])
        writer.addParam(2, [k & 255, 1, 100, 0])
        writer.txPacket()
        for servo_id in (1, 2):
            _, result, _ = packets.readTxRx(port, servo_id, 36, 8)
            if result:
                raise RuntimeError("a servo did not answer")

    try:
        yield cycle
    finally:
        port.closePort()


@contextmanager
def rustypot(port_name: str) -> Iterator[Callable[[int], object]]:
    """Use rustypot from PyPI, which writes goals without speeds, 4 bytes less."""
    import rustypot as library

    controller = library.AxPyController(port_name, 1_000_000, 0.1)

    def cycle(k: int) -> None:
        controller.sync_write_raw_goal_position([1, 2], [512 + (k & 255), 256 + (k & 255)])
        for servo_id in (1, 2):
            controller.read_raw_data(servo_id, 36, 8)

    try:
        yield cycle
    finally:
        controller.close()


def contenders() -> dict[str, Any]:
    """Return the drivers that are installed, by name."""
    found: dict[str, Any] = {"port": ours, "whole bus": whole_bus, "dynamixel_sdk": sdk}
    with suppress(ImportError):
        import rustypot as _  # noqa: F401

        found["rustypot"] = rustypot
    return found


@contextmanager
def busy_cores() -> Iterator[None]:
    """Other processes that keep every core busy."""
    spin = [sys.executable, "-c", "while True: pass"]
    others = [subprocess.Popen(spin) for _ in range(os.cpu_count() or 1)]
    try:
        yield
    finally:
        for other in others:
            other.terminate()
            other.wait()


def median_cycle(contender: Any, port_name: str, loaded: bool) -> Cost:
    """Medians over the cycles of one round."""
    walls: list[float] = []
    with busy_cores() if loaded else nullcontext(), contender(port_name) as cycle:
        for k in range(WARM_UP):
            cycle(k)
        gc.collect()
        before = time.process_time()
        for k in range(CYCLES):
            start = time.perf_counter()
            cycle(k)
            walls.append(time.perf_counter() - start)
        used = time.process_time() - before
    return Cost(statistics.median(walls) * 1e6, used / CYCLES * 1e6)


def _attempts(contender: Any, port_name: str, loaded: bool) -> Cost | None:
    for _ in range(3):  # a contender may give up on a machine that is busy
        try:
            return median_cycle(contender, port_name, loaded)
        except (OSError, RuntimeError, DynamixelError) as error:
            report(f"gave up: {error}")
    return None


def rounds(return_delay: int, loaded: bool) -> dict[str, Cost]:
    """Median of the rounds, by contender."""
    with elsewhere(return_delay) as (port_name, *_):
        costs = in_turns(
            {
                name: partial(_attempts, contender, port_name, loaded)
                for name, contender in contenders().items()
            },
            LOADED_ROUNDS if loaded else ROUNDS,
        )
    return {name: Cost(*medians(filter(None, each))) for name, each in costs.items() if any(each)}


def bus() -> str:
    """Return the table."""
    return table("work | ours | others | asked for", _rows())


def _rows() -> Iterator[str]:
    quiet = rounds(0, loaded=False)
    yield _wall_row(0, quiet, "1.15x, and rustypot's")
    yield processor_row(quiet)
    yield _wall_row(500, rounds(500, loaded=False), "1.07x")
    yield _row(
        "median cycle, return delay 0, every core busy with other processes",
        {
            name: f"{cost.wall:.0f} us ({cost.wall / quiet[name].wall:.2f}x unloaded)"
            for name, cost in rounds(0, loaded=True).items()
            if name in quiet
        },
        "1.1x unloaded",
    )
    yield from (in_a_run(), silent_servo(), faulty_cycles())


def _wall_row(return_delay: int, costs: dict[str, Cost], wanted: str) -> str:
    wire = WIRE[return_delay]
    return _row(
        f"median cycle of two AX-12, return delay {return_delay} us; the wire takes {wire:.0f} us",
        {name: f"{cost.wall:.0f} us ({cost.wall / wire:.2f}x)" for name, cost in costs.items()},
        wanted,
    )


def _row(work: str, figures: dict[str, str], wanted: str) -> str:
    own = ("port", "whole bus")
    mine = [f"{name} **{figures.get(name, 'gave up in every round')}**" for name in own]
    others = [f"{name} {text}" for name, text in figures.items() if name not in own]
    return row(work, "; ".join(mine), "; ".join(others), wanted)


def silent_servo() -> str:
    """Measure the delay of one servo when the other falls silent."""
    firsts, others, rates = [], [], []
    for _ in range(9):
        with elsewhere() as (port_name, server, _):
            driver = ServoBus(DynamixelPort(port_name), JOINTS)
            driver.connect()
            usual = []
            for _ in range(100):
                start = time.perf_counter()
                driver.step()
                usual.append(time.perf_counter() - start)
            normal = statistics.median(usual)
            server.send_signal(signal.SIGUSR1)
            time.sleep(0.05)
            cycles, good, longest = 100, 0, 0.0
            due = time.perf_counter()
            for k in range(cycles):
                start = time.perf_counter()
                good += "joint_1" in driver.step().states
                taken = time.perf_counter() - start - normal
                if k == 0:
                    firsts.append(taken)
                else:
                    longest = max(longest, taken)
                due += 0.01
                time.sleep(max(0.0, due - time.perf_counter()))
            others.append(longest)
            rates.append(good / cycles)
            driver.close()
    return row(
        "one of two servos falls silent, at 100 cycles a second",
        f"first cycle **{statistics.median(firsts) * 1e3:.1f} ms longer**, later ones at most "
        f"{statistics.median(others) * 1e3:.1f} ms; the other answers in "
        f"{100 * min(rates):.0f} % of the cycles",
        "dynamixel_sdk waits 34 ms in every cycle",
        "5 ms once, full rate",
    )


def faulty_cycles() -> str:
    """Run cycles with all simulated faults, in simulated time, with two models and protocols."""
    random = Random(4)
    faults = Faults(random, 0.0, tuple(Fault), late=(0.005, 0.05))
    # boot_time 0: what counts is the time from when a servo listens again
    servos = [
        SimulatedServo(1, boot_time=0.0),
        SimulatedServo(2, servo_model("XM430-W350"), boot_time=0.0),
    ]
    simulated = SimulatedBus(servos, faults=faults, kept_writes=10 * FAULTY_CYCLES)
    joints = [
        JointConfiguration("ax", 1, 512, 300, 800, controller="ax_controller"),
        JointConfiguration(
            "xm", 2, 2048, 1024, 3072, controller="xm_controller", model=servo_model("XM430-W350")
        ),
    ]
    run = FaultyRun(simulated, joints=joints)
    back: list[float] = []
    for _ in range(FAULTY_CYCLES // BURST):
        faults.rate = FAULT_RATE
        for k in range(BURST):
            run.cycle(recover=k % 50 == 0)
        faults.rate = 0.0
        rest = 0
        while faults.trouble or rest < 20 or run.full_since == sys.maxsize:
            rest = 0 if faults.trouble else rest + 1
            run.cycle(recover=False)
        back.append((run.full_since - max(faults.last, run.recovered)) * 1e-6)
    outside = 0
    for joint in joints:
        lowest, highest = joint.tick_range
        outside += sum(
            not lowest <= taken.goal <= highest
            for taken in simulated.writes
            if taken.id == joint.id and "Goal Position" in taken.names
        )
    struck = sum(faults.counts.values())
    overlaps = run.bench.line.overlaps
    spoken_over = overlaps[Overlap.REQUEST] + overlaps[Overlap.STATUS]
    late = overlaps[Overlap.FAULT]
    return row(
        f"{run.cycles} cycles of an AX-12 and an XM430, {100 * FAULT_RATE:.0f} % of the answers "
        f"and of the packets struck by one of {len(Fault)} faults: {struck}",
        f"**{run.exceptions} exceptions, {outside} goals outside the limits, {run.stale} stale "
        f"values, {spoken_over} times somebody spoken over** (and {late} times by a servo that a "
        f"fault made late); full rate again at most **{max(back):.0f} ms** after the last",
        "",
        "none; 100 ms",
    )


class FaultyRun(Rig):
    """Runs cycles and judges them by the true angles.

    Attributes:
        cycles: so many.
        exceptions: cycles that raised.
        stale: positions that were true at another time only.
        recovered: when a fault was last cleared [ns].
        full_since: the first of the latest cycles that have all read every joint [ns].
    """

    cycles = exceptions = stale = recovered = full_since = 0

    def cycle(self, recover: bool) -> None:
        """One cycle at 50 Hz with a new command."""
        bus, clock = self.bus, self.bench.clock
        self.cycles += 1
        goals = {
            joint.joint_name: Goal(0.6 * math.sin(0.02 * self.cycles + joint.id), 3.0)
            for joint in self.joints
            if not bus.joint(joint.joint_name).torque.refuses
        }
        with suppress(GoalError):
            bus.command(goals)
        try:
            self.step()
            torques = [bus.joint(joint.joint_name).torque for joint in self.joints]
            if recover and Torque.OFF_BY_FAULT in torques:
                self.recovered = clock.now
                with suppress(DynamixelError):
                    run(bus.recovering())
        except Exception:
            self.exceptions += 1
        if len(self.reading.states) < len(self.joints):
            self.full_since = sys.maxsize
        else:
            self.full_since = min(self.full_since, clock.now)
        for joint in self.joints:
            state = self.reading.states.get(joint.joint_name)
            if state is not None:
                age = (clock.now - state.stamp) * 1e-9 + 0.001
                true = joint.position(self.bench.bus[joint.id].true_ticks)
                self.stale += abs(true - state.position) > 2 * joint.resolution + 7.0 * age


def processor_row(costs: dict[str, Cost]) -> str:
    """Processor time of a cycle, over that of rustypot's transport."""
    least = costs["rustypot"].processor if "rustypot" in costs else math.nan
    figures = {
        name: f"{cost.processor:.0f} us ({cost.processor / least:.2f}x rustypot)"
        for name, cost in costs.items()
    }
    return _row("processor time of that cycle", figures, "port 1.2x, whole bus 2.0x")


def in_a_run() -> str:
    """Measure the duration of a cycle in a run with page, camera and detector."""
    times: dict[str, list[float]] = {}
    runs = {
        "with page, camera and detector": ("--target", "face", "--viewer"),
        "without": ("--target", "none"),
    }
    for name, arguments in runs.items():
        done = subprocess.run(
            [sys.executable, str(TIMED), "--sim", "--duration", "30", *arguments],
            stdout=subprocess.PIPE,
            text=True,
            check=False,
        )
        lists = [line for line in done.stdout.splitlines() if line.startswith("[")]
        times[name] = json.loads(lists[-1])[WARM_UP:]
    figures = "; ".join(
        f"{name} median {1e3 * each[9]:.1f} ms, p95 {1e3 * each[18]:.1f} ms"
        for name, took in times.items()
        for each in (statistics.quantiles(took, n=20),)
    )
    return row("a cycle of the bus in `head_tracking --sim`", f"**{figures}**", "", "p95 3 ms")
