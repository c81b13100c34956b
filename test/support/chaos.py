"""Injects random faults into a running head, and checks what its servos do.

    chaos.py --seed N [--seconds S] [--run composed|nodes] [--clock]

The servos are simulated in this process, so they survive every fault of the robot. Their write log
and their true positions show what happened. The robot is a run, or one process for each node, with
a page beside it. A target swings slowly, and the seed decides the order of the faults. Conditions:

- No motion without a command: no torque before the first target, no goal away from the targets, and
  nothing but torque off from STOP until resume.
- STOP relaxes both servos within 0.5 s, or when a disconnected adapter is back.
- The head is on its target again within 2 s after the last fault.

The output is one line of JSON with the faults and the slowest STOP and recovery. If a condition is
violated, stderr has the seed and the latest faults, and the exit code is 1. Time limits are
extended by the time for which processes waited for a core.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import rclpy
import yaml
from geometry_msgs.msg import Point, PointStamped
from rclpy.node import Node
from rclpy.time import Time
from rig import JOINTS, LATCHED, SOURCE, TICK, Bench, Program
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool, Trigger
from waiting import join

from head_tracking.gaze import PanTiltHead
from head_tracking.share import robot_file
from head_tracking.simulation import Write
from head_tracking.transforms import load_robot_model

STOP_LIMIT = 0.5  # s
RECOVERY_LIMIT = 2.0  # s
START_LIMIT = 30.0  # s
ON_TARGET = math.radians(3.0)
POSITION_MARGIN = 0.5  # rad beside the range of the targets for the head
GOAL_MARGIN = 1.3  # rad for goals, which lie ahead of the head
FOREIGN = -2.2  # rad; other programs command this position, away from every target
INVALID = (math.nan, math.inf, -math.inf)
NODES = ("servo_bus", "robot_state_publisher", "joint_state_publisher", "head_tracker")


class ViolatedError(AssertionError):
    """Something moved without a command, did not stop, or did not recover."""


def time_without_core() -> float:
    """Return for how long some process has waited for a core since boot [s]; 0 if not known."""
    try:
        line = Path("/proc/pressure/cpu").read_text().splitlines()[0]
    except OSError:
        return 0.0
    return int(line.rsplit("total=", 1)[1]) * 1e-6


# Floods


def flood() -> None:
    """Publish invalid messages as fast as possible, in a process of its own.

    Each line of stdin is `targets|commands SECONDS SEED`.
    """
    rclpy.init(args=[])
    node = Node("flooder")
    topics = {"targets": (PointStamped, "target_point"), "commands": (JointState, "joint_commands")}
    for order in sys.stdin:
        what, seconds, seed = order.split()
        rnd = random.Random(seed)
        make = invalid_target if what == "targets" else invalid_command
        messages = [make(rnd) for _ in range(99)]
        publisher = node.create_publisher(*topics[what], 10)
        discovered = time.monotonic() + 0.5
        while not publisher.get_subscription_count() and time.monotonic() < discovered:
            time.sleep(0.01)
        end = time.monotonic() + float(seconds)
        while time.monotonic() < end:
            publisher.publish(rnd.choice(messages))
            time.sleep(5e-5)
        node.destroy_publisher(publisher)  # a run does not start beside another commander


def invalid_target(rnd: random.Random) -> PointStamped:
    frame_id = rnd.choice(("base_link", "nowhere", "", "a/b", "x" * 99))
    last = (*INVALID, 1e308) if frame_id == "base_link" else (0.5, 1e308)
    numbers = [1.0, -2.0, rnd.choice(last)]
    rnd.shuffle(numbers)
    message = PointStamped(point=Point(x=numbers[0], y=numbers[1], z=numbers[2]))
    message.header.frame_id = frame_id
    message.header.stamp = Time(seconds=time.time() + rnd.choice((0.0, -1e6, 1e6))).to_msg()
    return message


def invalid_command(rnd: random.Random) -> JointState:
    message = JointState(name=rnd.choice((list(JOINTS), [JOINTS[0]], ["nobody"], [""], [])))
    if message.name == ["nobody"]:
        message.position = [FOREIGN]
    elif rnd.random() < 0.3:
        message.position = [FOREIGN] * (len(message.name) + 1)
    else:
        message.position = [rnd.choice(INVALID) for _ in message.name]
    return message


class Chaos:
    """The robot, its servos, and the faults.

    Args:
        bench: the domain and the servos.
        seed: of all random choices.
        layout: "composed" (a run) or "nodes" (a process for each node).
        clock: whether the robot uses `/clock`, which jumps.
    """

    def __init__(self, bench: Bench, seed: int, layout: str, clock: bool) -> None:
        self.bench, self.random, self.layout, self.clock = bench, random.Random(seed), layout, clock
        self.faults: Counter[str] = Counter()
        self.journal: list[str] = []
        self.slowest_stop = self.slowest_recovery = 0.0
        self.stops = self.recoveries = 0
        self._start_time = time.monotonic()
        self._offset = 0.0  # s, of the robot's clock
        self._is_commanded = self._is_stopped = self._bus_is_stopped = False
        self._owners = self._state = ""
        self._joints_received = self._state_received = self._recovered = -math.inf
        self._trace: deque[str] = deque(maxlen=40)
        self._writes: deque[Write] = deque(maxlen=12)
        model = load_robot_model(robot_file("kinectbot"))
        self._head = PanTiltHead(model, *JOINTS, "camera_link")
        self._head_from_base = model.transform(self._head.base_frame, "base_link", {})
        targets = [self._head_from_base @ self.target_at(0.1 * k) for k in range(110)]
        gazes = [self._head.gaze(target, 0.0, 0.0) for target in targets]
        self._ranges = [
            (min(0.0, *angles), max(0.0, *angles))
            for angles in zip(*((gaze.pan, gaze.tilt) for gaze in gazes), strict=True)
        ]
        self.servos = bench.servos
        self.programs: dict[str, Program] = {}
        self.started: dict[str, float] = {}
        self._connect()
        self._parameters = bench.folder / "robot.yaml"
        values = {"use_sim_time": clock, "robot": "kinectbot", "port_name": self.servos.name}
        self._parameters.write_text(
            yaml.safe_dump({"/**": {"ros__parameters": values | {"reply_timeout": 0.1}}})
        )
        for name in NODES if layout == "nodes" else ("run",):
            self.start(name)
        if importlib.util.find_spec("nicegui"):
            self.start("page")

    def _connect(self) -> None:
        """Subscribe to the robot, and start the publishers of clock, target and floods."""
        node = self.node = self.bench.person.node
        self._targets = node.create_publisher(PointStamped, "target_point", 10)
        self._clocks = node.create_publisher(Clock, "/clock", 10)
        for kind, topic, callback, qos in (
            (String, "joint_owners", self._on_owners, LATCHED),
            (String, "head_tracker/state", self._on_state, LATCHED),
            (Bool, "stopped", self._on_stopped, LATCHED),
            (JointState, "joint_states", self._on_joints, 10),
        ):
            node.create_subscription(kind, topic, callback, qos)
        self._stop = node.create_client(Trigger, "stop")
        self._resume = node.create_client(Trigger, "resume")
        self._enable = node.create_client(SetBool, "head_tracker/enable")
        self._flooder = subprocess.Popen(
            [sys.executable, __file__, "--flood"],
            stdin=subprocess.PIPE,
            text=True,
            env=os.environ | {"ROS_DOMAIN_ID": self.bench.domain},
        )
        self._ending = threading.Event()
        self._publishing = threading.Thread(target=self._publish, daemon=True)
        self._publishing.start()

    def close(self) -> None:
        self._ending.set()
        join(self._publishing)
        self._flooder.kill()
        self._flooder.wait(30.0)
        for name in self.programs:
            self.kill_group(name)

    def start(self, name: str) -> None:
        files = (SOURCE / "config" / "kinectbot.yaml", self._parameters)
        words = ("--ros-args", *(w for file in files for w in ("--params-file", str(file))))
        if name == "run":
            words = ("--port", self.servos.name, "--params", str(self._parameters))
        elif name == "page":
            words = ("--ros-args", "-p", "port:=0")
        program = {"run": "head_tracking", "page": "viewer"}.get(name, name)
        self.started[name] = time.monotonic()
        self.programs[name] = self.bench.start(program, *words, own_group=True)

    def kill_group(self, name: str) -> None:
        with suppress(ProcessLookupError):
            os.killpg(self.programs[name].process.pid, signal.SIGKILL)
        self.programs[name].kill()

    def _on_joints(self, message: JointState) -> None:
        if JOINTS[0] in message.name:
            self._joints_received = time.monotonic()

    def _on_state(self, message: String) -> None:
        self._state, self._state_received = message.data, time.monotonic()

    def _on_owners(self, message: String) -> None:
        self._owners = message.data

    def _on_stopped(self, message: Bool) -> None:
        self._bus_is_stopped = message.data

    # The target

    def target_at(self, elapsed: float) -> tuple[float, float, float]:
        """Return the target in base_link [m] at a time after the start [s]."""
        bearing = 0.35 + 0.15 * math.sin(0.6 * elapsed)
        return 2.0 * math.cos(bearing), 2.0 * math.sin(bearing), 1.0 + 0.1 * math.cos(0.6 * elapsed)

    def _publish(self) -> None:
        """Publish the clock at 100 Hz and the target at 33 Hz."""
        turn = 0
        while not self._ending.wait(0.01):
            turn += 1
            stamp = Time(seconds=time.time() + self._offset).to_msg()
            if self.clock:
                self._clocks.publish(Clock(clock=stamp))
            if self._is_commanded and turn % 3 == 0:
                x, y, z = self.target_at(time.monotonic() - self._start_time)
                message = PointStamped(point=Point(x=x, y=y, z=z))
                message.header.frame_id = "base_link"
                message.header.stamp = stamp
                self._targets.publish(message)

    # Checks

    def is_relaxed(self) -> bool:
        return self.servos.torque == [0, 0]

    def error(self) -> float:
        """Return the true angle between the camera's axis and the target [rad]."""
        target = self._head_from_base @ self.target_at(time.monotonic() - self._start_time)
        return self._head.miss(target, *self.servos.true)

    def is_on_target(self) -> bool:
        return self.error() < ON_TARGET

    def check(self) -> None:
        """Check the servos' writes since the last call and their positions.

        Raises:
            ViolatedError: something moved without a command.
        """

        def take(bus: Any) -> list[Write]:
            writes = list(bus.write_log.writes)
            bus.write_log.writes.clear()
            return writes

        for write in self.servos.port.use(take):
            self._writes.append(write)
            if write.torque and not self._is_commanded:
                raise ViolatedError(f"torque before the first command: {write}")
            if write.torque and self._is_stopped:
                raise ViolatedError(f"torque after STOP: {write}")
            if write.torque and "Goal Position" in write.names:
                self._check_range(write.id - 1, TICK * (write.goal - 512), GOAL_MARGIN, "goal")
        pan, tilt = self.servos.true
        now, error = time.monotonic() - self._start_time, math.degrees(self.error())
        line = f"{now:7.1f} s  {pan:6.2f} {tilt:6.2f} {error:5.1f} {self._state[:60]}"
        if not self._trace or self._trace[-1][:9] != line[:9]:
            self._trace.append(line)
        for index, position in enumerate((pan, tilt)):
            self._check_range(index, position, POSITION_MARGIN, "position")

    def _check_range(self, index: int, angle: float, margin: float, what: str) -> None:
        low, high = self._ranges[index]
        if not low - margin <= angle <= high + margin:
            raise ViolatedError(
                f"{what} {angle:.2f} rad of {JOINTS[index]} without a command: the targets are at "
                f"{low:.2f} to {high:.2f} rad"
            )

    def report(self) -> Iterator[str]:
        """Return the latest faults, states, writes and log lines."""
        yield from self.journal[-40:]
        yield f"owners: {self._owners!r}, {self._state}"
        yield "time; true pan and tilt [rad]; error [degrees]; state"
        yield from self._trace
        now = time.monotonic_ns()
        yield from (f"{(write.time - now) * 1e-9:7.2f} s: {write}" for write in self._writes)
        for name, program in self.programs.items():
            lines = [line for line in program.output.splitlines() if "| bus " not in line]
            yield from (f"--- {name}", *lines[-25:])

    def wait(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            time.sleep(min(0.02, left))
            self.check()

    def until(self, condition: Callable[[], bool], limit: float, name: str) -> float:
        """Wait for a condition; return how long it took [s].

        Raises:
            ViolatedError: it took longer than `limit` [s] and the time without a core.
        """
        start, without_core = time.monotonic(), time_without_core()
        while not condition():
            self.check()
            if time.monotonic() - start > limit + time_without_core() - without_core:
                raise ViolatedError(f"{name}: not within {limit:g} s")
            time.sleep(0.005)
        return time.monotonic() - start

    def is_complete(self) -> bool:
        """Return whether all programs run, and restarted ones have found the others.

        Raises:
            ViolatedError: a program has ended by itself.
        """
        ended = [n for n, program in self.programs.items() if program.process.poll() is not None]
        if ended:
            raise ViolatedError(f"{', '.join(ended)} ended")
        robot = max(started for name, started in self.started.items() if name != "page")
        tracker = self.started.get("run", self.started.get("head_tracker", 0.0))
        return robot < self._recovered or (
            self._joints_received > robot
            and self._state_received > tracker
            and not (self._is_commanded and self._state.startswith(("idle", "stalled")))
            and self._stop.service_is_ready()
        )

    def wait_until_complete(self) -> None:
        self.until(self.is_complete, START_LIMIT, "the robot is complete")

    def wait_for_bus(self) -> None:
        def has_bus() -> bool:
            is_read = time.monotonic() - self._joints_received < 0.2
            return self._stop.service_is_ready() and is_read

        self.until(has_bus, START_LIMIT, "the bus is available")

    # Faults

    def note(self, text: str) -> None:
        self.journal.append(f"{time.monotonic() - self._start_time:7.2f} s  {text}")

    def inject(self) -> None:
        """Inject one random fault."""
        faults: list[tuple[int, Callable[[], None]]] = [
            (3, self.kill),
            (1, self.terminate),
            (2, self.freeze),
            (3, self.unplug),
            (3, self.flood_targets),
            (3, self.flood_commands),
            (2, self.foreign_commands),
            (3, self.stop),
            (1, self.stop_without_adapter),
        ]
        if self.clock:
            faults.append((3, self.jump))
        weights, functions = zip(*faults, strict=True)
        fault = self.random.choices(functions, weights)[0]
        self.faults[fault.__name__] += 1
        fault()
        self.check()

    def _any_program(self) -> str:
        return self.random.choice(sorted(self.programs))

    def kill(self) -> None:
        self._restart(signal.SIGKILL, self._any_program())

    def terminate(self) -> None:
        self._restart(signal.SIGTERM, self._any_program())

    def kill_stopped_bus(self) -> None:
        self._bus_is_stopped = False
        self._restart(signal.SIGKILL, "servo_bus")
        self.until(lambda: self._bus_is_stopped, START_LIMIT, "the new servo bus is stopped")

    def _restart(self, number: signal.Signals, name: str) -> None:
        process = self.programs[name].process
        self.note(f"{name} {number.name}")
        process.send_signal(number)
        if number == signal.SIGTERM:
            self.until(lambda: process.poll() is not None, 8.0, f"{name} ends by SIGTERM")
        else:
            self.wait(self.random.uniform(0.0, 0.6))
        self.kill_group(name)
        self.start(name)

    def freeze(self) -> None:
        name, seconds = self._any_program(), self.random.uniform(0.1, 1.0)
        self.note(f"{name} is frozen for {seconds:.2f} s")
        self.programs[name].process.send_signal(signal.SIGSTOP)
        self.wait(seconds)
        self.programs[name].process.send_signal(signal.SIGCONT)

    def unplug(self) -> None:
        self.wait_until_complete()  # without an adapter no robot starts
        seconds = self.random.uniform(0.05, 1.0)
        self.note(f"unplugged for {seconds:.2f} s")
        self.servos.port.close()
        self.wait(seconds)
        self.servos.port.open()

    def jump(self) -> None:
        step = self.random.choice((-1.0, 1.0)) * 10.0 ** self.random.uniform(-1.0, 4.0)
        self.note(f"the clock jumps by {step:.2f} s")
        self._offset += step
        self.wait(0.05)

    def flood_targets(self) -> None:
        self._flood("targets")

    def flood_commands(self) -> None:
        self._flood("commands")

    def _flood(self, what: str) -> None:
        seconds = self.random.uniform(0.1, 0.5)
        self.note(f"flood of {what} for {seconds:.2f} s")
        assert self._flooder.stdin is not None
        print(what, seconds, self.random.random(), file=self._flooder.stdin, flush=True)
        self.wait(0.1 + seconds)

    def foreign_commands(self) -> None:
        """Command joints that the tracker owns."""
        owners = [line for line in self._owners.splitlines() if line.strip()]
        is_owned = bool(owners) and all("head_tracker" in line for line in owners)
        if not (self.is_complete() and is_owned):  # during its start a tracker may lose its lease
            return
        self.note("foreign commands")
        message = JointState(name=list(JOINTS), position=[FOREIGN, 0.0], velocity=[1.0, 1.0])
        publisher = self.node.create_publisher(JointState, "joint_commands", 10)
        try:
            for _ in range(50):
                publisher.publish(message)
                self.wait(0.01)
        finally:
            self.node.destroy_publisher(publisher)

    # STOP

    def stop(self) -> None:
        self.wait_for_bus()
        self.until(self.is_on_target, START_LIMIT, "the head is on its target")
        self.note("STOP")
        answers = self._request(self._stop, Trigger.Request(), 0.1)

        def is_relaxed() -> bool:
            answers()
            return self.is_relaxed()

        taken = self.until(is_relaxed, STOP_LIMIT, "STOP relaxes")
        self.slowest_stop, self.stops = max(self.slowest_stop, taken), self.stops + 1
        self.until(lambda: any(answer.success for answer in answers()), 2.0, "STOP is confirmed")
        self._resume_later()

    def stop_without_adapter(self) -> None:
        """STOP while the adapter is unplugged: the servos are relaxed when it is back."""
        self.wait_until_complete()
        self.wait_for_bus()
        self.note("STOP while the adapter is unplugged")
        self.servos.port.close()
        self.wait(self.random.uniform(0.0, 0.3))
        answers = self._request(self._stop, Trigger.Request(), 0.1)
        self.until(lambda: bool(answers()), 2.0, "STOP answers without an adapter")
        if any(answer.success for answer in answers()) and not self.is_relaxed():
            raise ViolatedError("STOP is confirmed, but the servos are not relaxed")
        self.check()
        self.servos.port.open()
        self.until(self.is_relaxed, 3.0, "STOP relaxes when the adapter is back")
        self._resume_later()

    def _resume_later(self) -> None:
        """Inject faults that must not end the STOP, then resume."""
        self.check()
        self._is_stopped = True
        faults = [self.flood_targets, self.flood_commands, self.unplug]
        if "servo_bus" in self.programs:  # the other nodes remember the STOP
            faults.append(self.kill_stopped_bus)
        for _ in range(self.random.randrange(3)):
            self.random.choice(faults)()
        self.wait(self.random.uniform(0.2, 0.6))
        self.check()
        self._is_stopped = False
        self.note("resume")
        for client, request in (
            (self._resume, Trigger.Request()),
            (self._enable, SetBool.Request(data=True)),
        ):
            self.until(client.service_is_ready, START_LIMIT, f"{client.srv_name} is available")
            answers = self._request(client, request, 0.5)
            try:
                self.until(lambda: any(a.success for a in answers()), 5.0, client.srv_name)  # noqa: B023
            except ViolatedError as error:
                raise ViolatedError(f"{error}: {[a.message for a in answers()]}") from None

    def _request(self, client: Any, request: Any, period: float) -> Callable[[], list[Any]]:
        """Return a function that repeats a request until it is granted, and returns the answers.

        A request is lost if it is sent before client and service have discovered each other. A
        servo that is just coming back confirms nothing.
        """
        futures: list[Any] = []
        times = [-math.inf]

        def answers() -> list[Any]:
            received = [future.result() for future in futures if future.done()]
            is_granted = any(answer.success for answer in received)
            if not is_granted and time.monotonic() > times[-1] + period:
                futures.append(client.call_async(request))
                times.append(time.monotonic())
            return received

        answers()
        return answers

    def run(self, seconds: float) -> None:
        """Inject faults for a time, and let the robot recover in between.

        Raises:
            ViolatedError: a condition is violated.
        """
        self.until(self.is_complete, START_LIMIT, "the robot starts")
        for _ in range(2):  # before the first command
            self.random.choice((self.flood_targets, self.flood_commands, self.unplug))()
            self.wait(0.1)
        self._is_commanded = True
        self.until(self.is_on_target, START_LIMIT, "the head finds its target")
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            for _ in range(self.random.randrange(1, 4)):
                self.inject()
                self.wait(self.random.uniform(0.0, 0.4))
            self.wait_until_complete()
            self.note("the last fault")
            taken = self.until(
                lambda: self.is_on_target() and not self.is_relaxed(),
                RECOVERY_LIMIT,
                "the head is on its target again",
            )
            self.note(f"on the target again after {taken:.2f} s")
            self.slowest_recovery = max(self.slowest_recovery, taken)
            self.recoveries += 1
            self._recovered = time.monotonic()
            self.wait(0.3)


def main() -> int:
    """Test one robot; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--run", choices=("composed", "nodes"), default="composed")
    parser.add_argument("--clock", action="store_true")
    parser.add_argument("--flood", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    if options.flood:
        flood()
        return 0
    with tempfile.TemporaryDirectory() as folder, closing(Bench(Path(folder))) as bench:
        chaos = Chaos(bench, options.seed, options.run, options.clock)
        with closing(chaos):
            try:
                chaos.run(options.seconds)
            except ViolatedError as error:
                repeat = f"--seed {options.seed} --seconds {options.seconds:g} --run {options.run}"
                print(f"chaos {repeat}{' --clock' * options.clock}: {error}", file=sys.stderr)
                print(*chaos.report(), sep="\n", file=sys.stderr)
                return 1
        result = {
            "faults": chaos.faults,
            "stops": chaos.stops,
            "slowest_stop": round(chaos.slowest_stop, 3),
            "recoveries": chaos.recoveries,
            "slowest_recovery": round(chaos.slowest_recovery, 3),
        }
        print(json.dumps(result))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
