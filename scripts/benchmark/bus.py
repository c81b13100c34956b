"""The servo bus: how near it comes to the wire, and what it survives.

Ours, dynamixel_sdk's own way and rustypot take turns, round after round, on one simulated bus in
a process of its own, so that all of them see the machine in all its moods.
"""

from __future__ import annotations

import gc
import math
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

from dynamixel_sdk import GroupSyncWrite, PacketHandler, PortHandler

from head_tracking.dynamixel import (
    Adapter,
    BusEvent,
    BusReading,
    BusThread,
    DynamixelError,
    DynamixelPort,
    Goal,
    GoalError,
    JointConfiguration,
    ReadGroup,
    ReadMethod,
    ServoBus,
    Torque,
    servo_model,
)
from head_tracking.dynamixel.port import Failed
from head_tracking.simulation import (
    Fault,
    Faults,
    Overlap,
    SimulatedBus,
    SimulatedClock,
    SimulatedLine,
    SimulatedPort,
    SimulatedServo,
    WriteLog,
)

SERVER = Path(__file__).parent / "paced_bus.py"
WIRE = {0: 620.0, 500: 1620.0}  # us: sync write of 18 bytes, and twice 8 bytes out and 14 back
ROUNDS, LOADED_ROUNDS, CYCLES, WARM_UP = 15, 7, 150, 20
FAULTY_CYCLES, BURST, FAULT_RATE = 100_000, 1000, 0.05
PERIOD = 20_000_000  # ns
REPLUGS = 100
BESIDE_ROUNDS, BESIDE_CYCLES = 3, 250


class Cost(NamedTuple):
    """What a cycle costs, us: from begin to end, and processor."""

    wall: float
    processor: float


@contextmanager
def ours(port_name: str) -> Iterator[Callable[[int], object]]:
    """`DynamixelPort`: the reads and the sync write, as `ServoBus` uses it."""
    port = DynamixelPort(port_name)
    port.open()
    group = ReadGroup(ReadMethod.EACH, 1, 36, 8, (1, 2))

    def cycle(k: int) -> None:
        replies = port.read_group(group)
        port.sync_write(30, {1: bytes((k & 255, 2, 100, 0)), 2: bytes((k & 255, 1, 100, 0))})
        if any(isinstance(reply, Failed) for reply in replies):
            raise RuntimeError("a servo did not answer")

    try:
        yield cycle
    finally:
        port.close()


@contextmanager
def whole_bus(port_name: str) -> Iterator[Callable[[int], object]]:
    """`ServoBus.step` with a new command each cycle: units, limits, protection and all."""
    joints = [JointConfiguration(f"joint_{i}", f"controller_{i}", i) for i in (1, 2)]
    bus = ServoBus(DynamixelPort(port_name), joints)
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
    """dynamixel_sdk as its examples use it."""
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
    """The one from PyPI; it writes goals without speeds, 4 bytes less."""
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
    """By name, ours first; without what is not installed."""
    found: dict[str, Any] = {"port": ours, "whole bus": whole_bus, "dynamixel_sdk": sdk}
    with suppress(ImportError):
        import rustypot as _  # noqa: F401

        found["rustypot"] = rustypot
    return found


@contextmanager
def served(return_delay: int, *silent: int) -> Iterator[str]:
    """The port of a paced bus in a process of its own."""
    command = [sys.executable, str(SERVER), str(return_delay), *map(str, silent)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip()
        finally:
            process.terminate()


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


def median_cycle(contender: Any, port_name: str) -> Cost:
    """Medians over the cycles of one round."""
    walls: list[float] = []
    with contender(port_name) as cycle:
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


def rounds(return_delay: int, loaded: bool) -> dict[str, Cost]:
    """Median of the rounds, by contender."""
    costs: dict[str, list[Cost]] = {}
    with served(return_delay) as port_name:
        for _ in range(LOADED_ROUNDS if loaded else ROUNDS):
            for name, contender in contenders().items():
                for _ in range(3):  # a contender may give up on a machine that is busy
                    with suppress(OSError, RuntimeError, DynamixelError):
                        costs.setdefault(name, []).append(_cost(contender, port_name, loaded))
                        break
    return {
        name: Cost(
            statistics.median(cost.wall for cost in each),
            statistics.median(cost.processor for cost in each),
        )
        for name, each in costs.items()
        if each
    }


def _cost(contender: Any, port_name: str, loaded: bool) -> Cost:
    if not loaded:
        return median_cycle(contender, port_name)
    with busy_cores():
        return median_cycle(contender, port_name)


def bus() -> str:
    """The table; each row is also shown when it is made."""
    rows = ["| work | ours | others | asked for |", "|---|---|---|---|"]
    for row in _rows():
        print(row, file=sys.stderr, flush=True)
        rows.append(row)
    return "\n".join(rows)


def _rows() -> Iterator[str]:
    quiet = rounds(0, loaded=False)
    yield _wall_row(0, quiet, "1.15x, and rustypot's")
    yield _row(
        "processor time of that cycle",
        {name: f"{cost.processor:.0f} us" for name, cost in quiet.items()},
        "60 us",
    )
    yield _wall_row(500, rounds(500, loaded=False), "1.07x")
    yield _row(
        "median cycle, return delay 0, every core busy with other processes",
        {
            name: f"{cost.wall:.0f} us ({cost.wall / quiet[name].wall:.2f}x unloaded)"
            for name, cost in rounds(0, loaded=True).items()
        },
        "1.1x unloaded",
    )
    yield node_part()
    yield beside_a_busy_thread()
    yield silent_servo()
    yield returning_servo()
    yield replugging()
    yield faulty_cycles()


def _wall_row(return_delay: int, costs: dict[str, Cost], wanted: str) -> str:
    wire = WIRE[return_delay]
    return _row(
        f"median cycle of two AX-12, return delay {return_delay} us; the wire takes {wire:.0f} us",
        {name: f"{cost.wall:.0f} us ({cost.wall / wire:.2f}x)" for name, cost in costs.items()},
        wanted,
    )


def _row(work: str, figures: dict[str, str], wanted: str) -> str:
    mine = [f"{name} **{figures[name]}**" for name in ("port", "whole bus") if name in figures]
    others = [
        f"{name} {text}" for name, text in figures.items() if name not in ("port", "whole bus")
    ]
    return f"| {work} | {'; '.join(mine)} | {'; '.join(others)} | {wanted} |"


def silent_servo() -> str:
    """One of two servos falls silent: what that costs the other."""
    firsts, others, rates = [], [], []
    for _ in range(9):
        with served(0, 2) as port_name:
            joints = [JointConfiguration(f"joint_{i}", f"controller_{i}", i) for i in (1, 2)]
            driver = ServoBus(DynamixelPort(port_name), joints)
            driver.connect(allow_missing=True)
            silent = driver._joints["joint_2"]
            silent.stopped = True
            usual = []
            for _ in range(100):
                start = time.perf_counter()
                driver.step()
                usual.append(time.perf_counter() - start)
            silent.stopped = False
            for servo in silent.servos:  # it has answered until now
                servo.lost = servo.unseen = False
            driver._plan = None
            normal = statistics.median(usual)
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
    return (
        "| one of two servos falls silent, at 100 cycles a second | first cycle "
        f"**{statistics.median(firsts) * 1e3:.1f} ms longer**, later ones at most "
        f"{statistics.median(others) * 1e3:.1f} ms; the other answers in "
        f"{100 * min(rates):.0f} % of the cycles | dynamixel_sdk waits 34 ms in every cycle | "
        "5 ms once, full rate |"
    )


class SimulatedDevice:
    """An open device in simulated time."""

    adapter = Adapter()

    def __init__(self, line: SimulatedLine) -> None:
        self.line = line

    def close(self) -> None:
        """Nothing to do."""


def faulty_cycles() -> str:
    """Everything that can go wrong, in simulated time, with mixed models and protocols."""
    random = Random(4)
    faults = Faults(random, 0.0, tuple(Fault), late=(0.005, 0.05))
    # boot_time 0: what counts is the time from when a servo listens again
    servos = [
        SimulatedServo(1, boot_time=0.0),
        SimulatedServo(2, servo_model("XM430-W350"), boot_time=0.0),
    ]
    simulated = SimulatedBus(servos, faults=faults, write_log=WriteLog(10 * FAULTY_CYCLES))
    clock = SimulatedClock(PERIOD)
    line = SimulatedLine(simulated, clock)
    joints = [
        JointConfiguration("ax", "ax_controller", 1, 512, 300, 800),
        JointConfiguration(
            "xm", "xm_controller", 2, 2048, 1024, 3072, model=servo_model("XM430-W350")
        ),
    ]
    port = DynamixelPort("simulated", open_device=lambda *_: SimulatedDevice(line), clock=clock)
    driver = ServoBus(port, joints, lambda: clock.now, monotonic=lambda: clock.now)
    driver.connect()
    run = FaultyRun(driver, simulated, clock, joints)
    back: list[float] = []
    for _ in range(FAULTY_CYCLES // BURST):
        faults.rate = FAULT_RATE
        for k in range(BURST):
            run.cycle(recover=k % 50 == 0)
        faults.rate = 0.0
        rest = 0
        while faults.trouble or rest < 20:
            rest = 0 if faults.trouble else rest + 1
            run.cycle(recover=False)
        back.append((run.full_since - max(faults.last, run.recovered)) * 1e-6)
    outside = 0
    for joint in joints:
        lowest, highest = joint.tick_range
        outside += sum(
            not lowest <= taken.goal <= highest
            for taken in simulated.write_log.writes
            if taken.id == joint.id and "Goal Position" in taken.names
        )
    struck = sum(faults.counts.values())
    spoken_over = line.overlaps[Overlap.REQUEST] + line.overlaps[Overlap.STATUS]
    late = line.overlaps[Overlap.FAULT]
    return (
        f"| {run.cycles} cycles of an AX-12 and an XM430, {100 * FAULT_RATE:.0f} % of the answers "
        f"and of the packets struck by one of {len(Fault)} faults: {struck} | "
        f"**{run.exceptions} exceptions, {outside} goals outside the limits, {run.stale} stale "
        f"values, {spoken_over} times somebody spoken over** (and {late} times by a servo that a "
        f"fault made late); full rate again at most **{max(back):.0f} ms** after the last | | "
        "none; 100 ms |"
    )


class FaultyRun:
    """Runs cycles and judges them by the true angles.

    Attributes:
        cycles: so many.
        exceptions: cycles that raised.
        stale: positions that were true at another time only.
        recovered: when a fault was last cleared [ns].
        full_since: the first of the latest cycles that have all read every joint [ns].
    """

    def __init__(
        self,
        driver: ServoBus,
        simulated: SimulatedBus,
        clock: SimulatedClock,
        joints: list[JointConfiguration],
    ) -> None:
        self._driver, self._simulated, self._clock, self._joints = driver, simulated, clock, joints
        self._due = clock.now
        self.cycles = self.exceptions = self.stale = self.recovered = self.full_since = 0
        self.reading: BusReading = driver.step()

    def cycle(self, recover: bool) -> None:
        """One cycle at 50 Hz with a new command."""
        driver, clock = self._driver, self._clock
        self._due = max(self._due + PERIOD, clock.now)
        clock.now = self._due
        self.cycles += 1
        goals = {
            joint.joint_name: Goal(0.6 * math.sin(0.02 * self.cycles + joint.id), 3.0)
            for joint in self._joints
            if not driver.torque(joint.joint_name).waits
        }
        with suppress(GoalError):
            driver.command(goals)
        try:
            self.reading = driver.step()
            if recover and any(
                driver.torque(j.joint_name) is Torque.OFF_BY_FAULT for j in self._joints
            ):
                self.recovered = clock.now
                with suppress(DynamixelError):
                    driver.run(driver.recovering())
        except Exception:
            self.exceptions += 1
        if len(self.reading.states) < len(self._joints):
            self.full_since = sys.maxsize
        else:
            self.full_since = min(self.full_since, clock.now)
        for joint in self._joints:
            state = self.reading.states.get(joint.joint_name)
            if state is not None:
                age = (clock.now - state.stamp) * 1e-9 + 0.001
                true = joint.position(self._simulated[joint.id].true_ticks)
                self.stale += abs(true - state.position) > 2 * joint.resolution + 7.0 * age


def returning_servo() -> str:
    """The longest cycle while one of two servos returns and its torque comes on, simulated time."""
    found = []
    for baud_rate in (1_000_000, 57_600):
        servos = [SimulatedServo(1, boot_time=0.0), SimulatedServo(2, boot_time=0.0)]
        clock = SimulatedClock(PERIOD)
        line = SimulatedLine(SimulatedBus(servos), clock, baud_rate)
        port = DynamixelPort(
            "simulated", baud_rate, open_device=lambda *_, line=line: SimulatedDevice(line),
            clock=clock,
        )  # fmt: skip
        joints = [JointConfiguration(f"joint_{i}", f"controller_{i}", i) for i in (1, 2)]
        driver = ServoBus(port, joints, lambda c=clock: c.now, monotonic=lambda c=clock: c.now)
        driver.connect()

        def cycle(driver: ServoBus = driver, clock: SimulatedClock = clock) -> float:
            clock.now += PERIOD
            start = clock.now
            for name in ("joint_1", "joint_2"):
                with suppress(GoalError):
                    driver.command({name: Goal(0.2)})
            driver.step()
            return (clock.now - start) * 1e-6

        usual = max([cycle() for _ in range(100)][50:])
        servos[0].power_off()
        for _ in range(20):
            cycle()
        servos[0].power_on()
        longest = max(cycle() for _ in range(100))
        assert driver.torque("joint_1") is Torque.ON
        found.append(f"{longest:.1f} ms at {baud_rate} baud, where a usual one takes {usual:.1f}")
    return f"| longest cycle while one of two AX-12 returns | **{'; '.join(found)}** | | twice |"


def node_part() -> str:
    """From a reading to a published message, with a message that is filled anew or made anew."""
    import rclpy
    from sensor_msgs.msg import JointState

    from head_tracking.dynamixel import ErrorBits, ServoState
    from head_tracking.nodes.servo_bus import StatesMessage

    rclpy.init()
    node = rclpy.create_node("benchmark")
    publisher = node.create_publisher(JointState, "servo_states", 10)
    states = {
        f"joint_{i}": ServoState(
            f"joint_{i}", i, 10**18, 0.1, 0.2, 0.3, 12.0, 30.0, ErrorBits(0), True, 0.1
        )
        for i in (1, 2)
    }
    kept = StatesMessage(states)

    def anew() -> JointState:
        message = JointState()
        seconds, rest = divmod(sum(s.stamp for s in states.values()) // len(states), 10**9)
        message.header.stamp = type(message.header.stamp)(sec=seconds, nanosec=rest)
        message.name = [state.joint_name for state in states.values()]
        message.position = [state.position for state in states.values()]
        message.velocity = [state.velocity for state in states.values()]
        message.effort = [state.load for state in states.values()]
        return message

    def cost(make: Callable[[], JointState], publish: bool) -> float:
        start = time.perf_counter()
        for _ in range(2000):
            message = make()
            if publish:
                publisher.publish(message)
        return (time.perf_counter() - start) / 2000 * 1e6

    figures: dict[str, list[float]] = {}
    for _ in range(9):
        figures.setdefault("kept", []).append(cost(lambda: kept.filled(states), False))
        figures.setdefault("anew", []).append(cost(anew, False))
        figures.setdefault("kept, published", []).append(cost(lambda: kept.filled(states), True))
        figures.setdefault("anew, published", []).append(cost(anew, True))
    node.destroy_node()
    rclpy.try_shutdown()
    us = {name: statistics.median(each) for name, each in figures.items()}
    return (
        f"| the node's part, from a reading to a message | **{us['kept']:.1f} us**, with "
        f"publishing {us['kept, published']:.1f} us | a new message each time, as before: "
        f"{us['anew']:.1f} us, with publishing {us['anew, published']:.1f} us | half |"
    )


class TimedBus(ServoBus):
    """Notes how long each cycle takes [s]."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.took: list[float] = []
        self._began = math.nan

    def read(self) -> BusReading:
        """The first half of a cycle."""
        self._began = time.perf_counter()
        return super().read()

    def write(self) -> tuple[BusEvent, ...]:
        """The other half, after which the cycle counts."""
        events = super().write()
        self.took.append(time.perf_counter() - self._began)
        return events


def cycle_times(port_name: str) -> list[float]:
    """How long the cycles of a bus thread at 50 Hz take [s], with a command in each."""
    joints = [JointConfiguration(f"joint_{i}", f"controller_{i}", i) for i in (1, 2)]
    bus = TimedBus(DynamixelPort(port_name), joints)
    bus.connect()

    def command(_: BusReading) -> None:
        position = 0.001 * (len(bus.took) & 255)
        bus.command({"joint_1": Goal(position, 1.0), "joint_2": Goal(-position, 1.0)})

    thread = BusThread(bus, 50.0, command)
    thread.start()
    _wait(lambda: len(bus.took) >= WARM_UP + BESIDE_CYCLES)
    thread.stop()
    return bus.took[WARM_UP:]


def _in_another_process(port_name: str) -> list[float]:
    program = f"import bus as b; print(*b.cycle_times({port_name!r}))"
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=Path(__file__).parent,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return [float(word) for word in done.stdout.split()]


@contextmanager
def busy_thread() -> Iterator[None]:
    """A thread of this process that computes without pause."""
    done = threading.Event()

    def compute() -> None:
        while not done.is_set():
            sum(range(1000))

    thread = threading.Thread(target=compute)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def beside_a_busy_thread() -> str:
    """A cycle while another thread computes: in the same process, and with the bus in its own."""
    ways = {"own": _in_another_process, "same": cycle_times}
    took: dict[str, list[float]] = {name: [] for name in ways}
    with served(0) as port_name:
        for _ in range(BESIDE_ROUNDS):
            for name, measure in ways.items():
                with busy_thread():
                    took[name] += measure(port_name)
    shown = {
        name: f"median {each[9]:.1f} ms, p95 {each[18]:.1f} ms, longest {1e3 * max(took[name]):.1f}"
        for name, times in took.items()
        for each in ([1e3 * time for time in statistics.quantiles(times, n=20)],)
    }
    return (
        "| a cycle of two AX-12 at 50 Hz while another thread of the run computes without pause, "
        f"{len(took['own'])} cycles | bus in a process of its own (`--bus-process`): "
        f"**{shown['own']} ms** | in the same process: {shown['same']} ms | p95 2 ms |"
    )


def replugging() -> str:
    """The adapter unplugged and plugged in again, many times."""
    joints = [JointConfiguration(f"joint_{i}", f"controller_{i}", i) for i in (1, 2)]
    times: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        link = Path(folder) / "servos"
        with SimulatedPort([SimulatedServo(1), SimulatedServo(2)], link=link) as simulated:
            driver = ServoBus(DynamixelPort(str(link)), joints)
            driver.connect()
            newest: list[BusReading] = []
            thread = BusThread(driver, 50.0, newest.append)
            thread.start()
            _wait(lambda: newest and len(newest[-1].states) == 2)
            before = _resources()
            for _ in range(REPLUGS):
                simulated.unplug()
                _wait(lambda: len(newest[-1].lost) == 2)
                simulated.replug()
                start = time.perf_counter()
                _wait(lambda: len(newest[-1].states) == 2)
                times.append(time.perf_counter() - start)
            after = _resources()
            thread.stop()
    return (
        f"| unplugged and plugged in again {REPLUGS} times | **{len(times)} reconnections, the "
        f"slowest in {max(times):.2f} s**, median {statistics.median(times):.2f} s; threads "
        f"{after[0] - before[0]:+d}, file descriptors {after[1] - before[1]:+d} | | "
        f"{REPLUGS}, each within 1 s, nothing left behind |"
    )


def _resources() -> tuple[int, int]:
    return threading.active_count(), len(os.listdir("/proc/self/fd"))


def _wait(condition: Callable[[], object]) -> None:
    deadline = time.perf_counter() + 30.0
    while not condition():
        if time.perf_counter() > deadline:
            raise TimeoutError("waited 30 s in vain")
        time.sleep(0.002)


PARTS: dict[str, Callable[[], str]] = {
    "node": node_part,
    "beside": beside_a_busy_thread,
    "silent": silent_servo,
    "returning": returning_servo,
    "faulty": faulty_cycles,
    "replug": replugging,
}

if __name__ == "__main__":
    print("\n".join(PARTS[name]() for name in sys.argv[1:]))
