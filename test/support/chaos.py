"""Strikes a running head with whatever can happen to one, and watches its servos all the while.

    chaos.py --seed N [--seconds S] [--run composed|nodes] [--clock]

The servos are simulated in this process, behind a port that the robot's processes open: so they
outlive whatever is done to these, and their write log and true angles tell what really happened.
The robot is a run as a person starts it, or one process for each node, and a page beside it. A
person's target swings slowly; blows are struck in an order that the seed decides. What must hold:

- nothing moves that nobody commanded: no torque before the first target; no goal that is not on
  the way to the person's target; nothing but torque off from a STOP until it is lifted;
- STOP relaxes both servos within 0.5 s at any moment at which there is a bus and an adapter, and
  as soon as the adapter is back otherwise;
- 2 s after the last blow the head is on its target again.

Ends with one line of JSON: what was struck, and how long the slowest STOP and the slowest recovery
took. What did not hold is told on stderr with the seed and the blows before it, and the exit code
is 1. Limits of time are longer by the time in which somebody waited for a core.
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
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import rclpy
import yaml
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, PointStamped
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from ros_domain import own_domain
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool, Trigger

from head_tracking.dynamixel import JointConfiguration
from head_tracking.gaze import PanTiltHead
from head_tracking.share import robot_file
from head_tracking.simulation import SimulatedPort, SimulatedServo, Write
from head_tracking.transforms import load_robot_model

ROOT = Path(__file__).parents[2]
PAN = JointConfiguration("head_pan_joint", 1, controller="head_pan_controller")
TILT = JointConfiguration("head_tilt_joint", 2, controller="head_tilt_controller", min=300, max=800)
JOINTS = (PAN, TILT)
STOP_LIMIT = 0.5  # s
RECOVERY_LIMIT = 2.0  # s
ON_TARGET = math.radians(3.0)
BESIDE = 0.5  # rad beside the ways of the targets: there the head may be
AHEAD = 1.3  # rad beside them: there goals may be, which lie ahead of the head
START_LIMIT = 30.0  # s
LONG = 20.0  # s; a shorter life has no time for a colleague's run
FOREIGN = -2.2  # rad, where no target is: what foreigners command
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class DidNotHoldError(AssertionError):
    """Something moved, did not stop, or did not recover."""


class Program:
    """A process of the robot, started as often as it is wanted."""

    def __init__(self, name: str, arguments: list[str], log: Path) -> None:
        self.name = name
        self._arguments = arguments
        self._log = log
        self._process: subprocess.Popen[bytes] | None = None
        self.started = -math.inf

    @property
    def alive(self) -> bool:
        return self._process is not None and self._process.poll() is None

    @property
    def pid(self) -> int:
        assert self._process is not None
        return self._process.pid

    def start(self) -> None:
        self.started = time.monotonic()
        with self._log.open("ab") as log:
            log.write(f"--- {self.name} starts\n".encode())
            log.flush()
            self._process = subprocess.Popen(
                [sys.executable, *self._arguments],
                stdout=log,
                stderr=log,
                stdin=subprocess.DEVNULL,
                cwd=ROOT,
                start_new_session=True,
            )

    def signal(self, number: signal.Signals) -> None:
        if self.alive:
            os.kill(self.pid, number)

    def end(self) -> None:
        """Kills it, and whatever it has started."""
        if self._process is not None:
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()


def waited_for_a_core() -> float:
    """How long somebody on this machine has waited for a core up to now [s]; 0 if not known."""
    try:
        line = Path("/proc/pressure/cpu").read_text().splitlines()[0]
    except OSError:
        return 0.0
    return int(line.rsplit("total=", 1)[1]) * 1e-6


class Flooder:
    """Publishes what nobody can obey, up to 10 000 times a second, in a process of its own."""

    def __init__(self) -> None:
        program = [sys.executable, __file__, "--flood"]
        self._process = subprocess.Popen(program, stdin=subprocess.PIPE, text=True)

    def tell(self, order: str) -> None:
        assert self._process.stdin is not None
        print(order, file=self._process.stdin, flush=True)

    def end(self) -> None:
        self._process.kill()
        self._process.wait()


def flood() -> None:
    """What a `Flooder` does: an order is "targets" or "commands", how long [s], and a seed."""
    rclpy.init(args=[])
    node = Node("flooder")
    topics = {"targets": (PointStamped, "target_point"), "commands": (JointState, "joint_commands")}
    for order in sys.stdin:
        what, seconds, seed = order.split()
        rnd = random.Random(seed)
        messages = [_bad_target(rnd) if what == "targets" else _bad_command(rnd) for _ in range(99)]
        kind, topic = topics[what]
        publisher = node.create_publisher(kind, topic, 10)
        found = time.monotonic() + 0.5
        while not publisher.get_subscription_count() and time.monotonic() < found:
            time.sleep(0.01)
        end = time.monotonic() + float(seconds)
        while time.monotonic() < end:
            publisher.publish(rnd.choice(messages))
            time.sleep(5e-5)
        node.destroy_publisher(publisher)  # a run does not start beside one who commands


BAD = (math.nan, math.inf, -math.inf)


def _bad_target(rnd: random.Random) -> PointStamped:
    frame_id = rnd.choice(("base_link", "nowhere", "", "a/b", "x" * 99))
    last = (*BAD, 1e308) if frame_id == "base_link" else (0.5, 1e308)
    numbers = [1.0, -2.0, rnd.choice(last)]
    rnd.shuffle(numbers)
    message = PointStamped(point=Point(x=numbers[0], y=numbers[1], z=numbers[2]))
    message.header.frame_id = frame_id
    message.header.stamp = _stamp(max(0.0, time.time() + rnd.choice((0.0, -1e6, 1e6))))
    return message


def _bad_command(rnd: random.Random) -> JointState:
    names = [joint.joint_name for joint in JOINTS]
    message = JointState(name=rnd.choice((names, names[:1], ["nobody"], [""], [])))
    if message.name == ["nobody"]:
        message.position = [FOREIGN]
    elif rnd.random() < 0.3:
        message.position = [FOREIGN] * (len(message.name) + 1)
    else:
        message.position = [rnd.choice(BAD) for _ in message.name]
    return message


class Chaos:
    """The servos, the robot's processes, and who strikes them.

    Args:
        seed: decides all that is random.
        layout: "composed" (a run) or "nodes" (a process for each node).
        clock: whether the robot's clock is `/clock`, which jumps.
        folder: for the port, the robot's parameters and its logs.
    """

    def __init__(self, seed: int, layout: str, clock: bool, folder: Path) -> None:
        self.random = random.Random(seed)
        self.seed, self.layout, self.clock = seed, layout, clock
        self.struck: Counter[str] = Counter()
        self.journal: list[str] = []
        self.slowest_stop = self.slowest_recovery = 0.0
        self.stops = self.recoveries = 0
        self._folder = folder
        self._start = time.monotonic()
        self._offset = 0.0  # s, of the robot's clock
        self._targets = False
        self._seconds = 0.0
        self._ending = threading.Event()
        self._stopped = self._stopped_by_bus = False
        self._commanded = False
        self._owners = ""
        self._trace: deque[str] = deque(maxlen=40)
        self._traced = 0.0
        self._newest: deque[Write] = deque(maxlen=12)
        self._joints_heard = self._state_heard = -math.inf
        self._state = ""
        self._recovered = -math.inf
        self._ways: list[tuple[float, float]] = []
        model = load_robot_model(robot_file("kinectbot"))
        self._head = PanTiltHead(model, PAN.joint_name, TILT.joint_name, "camera_link")
        self._head_from_base = model.transform(self._head.base_frame, "base_link", {})

    # What is there

    def set_up(self, resources: ExitStack) -> None:
        """Servos, processes and the person."""
        servos = [SimulatedServo(j.id, j.model, position=j.init) for j in JOINTS]
        link = self._folder / "servos"
        self.port = resources.enter_context(SimulatedPort(servos, link=link, paced=True))
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        resources.callback(rclpy.try_shutdown)
        self.node = Node("person")
        self.targets = self.node.create_publisher(PointStamped, "target_point", 10)
        self.clocks = self.node.create_publisher(Clock, "/clock", 10)
        self.node.create_subscription(
            String, "joint_owners", lambda m: setattr(self, "_owners", m.data), LATCHED
        )
        self.node.create_subscription(JointState, "joint_states", self._on_joints, 10)
        self.node.create_subscription(String, "head_tracker/state", self._on_state, LATCHED)
        self.node.create_subscription(
            Bool, "stopped", lambda m: setattr(self, "_stopped_by_bus", m.data), LATCHED
        )
        self.stop_client = self.node.create_client(Trigger, "stop")
        self.resume_client = self.node.create_client(Trigger, "resume")
        self.enable_client = self.node.create_client(SetBool, "head_tracker/enable")
        self._flooder = Flooder()
        resources.callback(self._flooder.end)
        for work in (self._spin, self._publish):
            thread = threading.Thread(target=work)
            thread.start()
            resources.callback(thread.join)
        resources.callback(self._ending.set)
        self.programs = {program.name: program for program in self._programs(link)}
        for program in self.programs.values():
            resources.callback(program.end)
            program.start()
        self._find_bands()

    def _programs(self, link: Path) -> Iterator[Program]:
        parameters = self._folder / "robot.yaml"
        parameters.write_text(
            yaml.safe_dump(
                {
                    f"/**{node}": {"ros__parameters": values}
                    for node, values in (
                        ("", {"use_sim_time": self.clock}),
                        ("/servo_bus", {"port_name": str(link), "reply_timeout": 0.1}),
                        ("/robot_state_publisher", {"robot": "kinectbot"}),
                    )
                }
            )
        )
        files = [str(ROOT / "config" / "kinectbot.yaml"), str(parameters)]

        def program(name: str, *arguments: str) -> Program:
            return Program(name, ["-m", *arguments], self._folder / f"{name}.log")

        if self.layout == "nodes":
            ros = ["--ros-args", *(word for file in files for word in ("--params-file", file))]
            for name in (
                "servo_bus",
                "robot_state_publisher",
                "joint_state_publisher",
                "head_tracker",
            ):
                yield program(name, "head_tracking", name, *ros)
        else:
            yield program("run", "head_tracking", "--port", str(link), "--params", files[1])
        if importlib.util.find_spec("nicegui"):
            yield program("page", "head_tracking", "viewer", "--ros-args", "-p", "port:=0")

    def _spin(self) -> None:
        executor = SingleThreadedExecutor()
        executor.add_node(self.node)
        while not self._ending.is_set():
            executor.spin_once(timeout_sec=0.1)
        executor.shutdown()

    def _on_joints(self, message: JointState) -> None:
        if PAN.joint_name in message.name:
            self._joints_heard = time.monotonic()

    def _on_state(self, message: String) -> None:
        self._state, self._state_heard = message.data, time.monotonic()

    # The person's target

    @property
    def now(self) -> float:
        """On the robot's clock [s]."""
        return time.time() + self._offset

    def target_at(self, elapsed: float) -> tuple[float, float, float]:
        """Where the target is so long after the start [s]; in base_link [m]."""
        bearing = 0.35 + 0.15 * math.sin(0.6 * elapsed)
        return 2.0 * math.cos(bearing), 2.0 * math.sin(bearing), 1.0 + 0.1 * math.cos(0.6 * elapsed)

    def _publish(self) -> None:
        """The clock at 100 Hz, and the target at 33."""
        turn = 0
        while not self._ending.wait(0.01):
            turn += 1
            stamp = _stamp(self.now)
            if self.clock:
                self.clocks.publish(Clock(clock=stamp))
            if self._targets and turn % 3 == 0:
                x, y, z = self.target_at(time.monotonic() - self._start)
                message = PointStamped(point=Point(x=x, y=y, z=z))
                message.header.frame_id = "base_link"
                message.header.stamp = stamp
                self.targets.publish(message)

    def _find_bands(self) -> None:
        targets = [self._head_from_base @ self.target_at(0.1 * k) for k in range(110)]
        gazes = [self._head.gaze(target, 0.0, 0.0) for target in targets]
        for angles in ([gaze.pan for gaze in gazes], [gaze.tilt for gaze in gazes]):
            self._ways.append((min(0.0, *angles), max(0.0, *angles)))

    # The truth

    def positions(self) -> tuple[float, float]:
        """True pan and tilt [rad]."""
        pan, tilt = (joint.position(self.port.true_ticks(joint.id)) for joint in JOINTS)
        return pan, tilt

    def relaxed(self) -> bool:
        """Whether both servos' torque is off."""
        return self.port.use(lambda bus: not any(servo.register("Torque Enable") for servo in bus))

    def error(self) -> float:
        """The angle between the camera's axis and the target [rad]."""
        target = self._head_from_base @ self.target_at(time.monotonic() - self._start)
        return self._head.miss(target, *self.positions())

    def look(self) -> None:
        """Judges all that has reached the servos since it was looked the last time.

        Raises:
            DidNotHoldError: something moved that nobody commanded.
        """
        writes = self.port.use(lambda bus: list(bus.write_log.writes))
        self.port.use(lambda bus: bus.write_log.writes.clear())
        self._newest.extend(writes)
        for write in writes:
            joint = JOINTS[write.id - 1]
            switched_on = "Torque Enable" in write.names and write.torque
            if not self._commanded and write.torque:
                raise DidNotHoldError(f"{joint.joint_name} got torque before anybody commanded it")
            if self._stopped and write.torque:
                raise DidNotHoldError(
                    f"{joint.joint_name} {'got torque' if switched_on else 'has torque'} "
                    f"after STOP: {write}"
                )
            if "Goal Position" in write.names and write.torque:
                self._check(write.id - 1, joint.position(write.goal), AHEAD, "was sent to")
        positions = self.positions()
        now = time.monotonic() - self._start
        if now > self._traced + 0.1:
            self._traced = now
            pan, tilt = positions
            error = math.degrees(self.error())
            self._trace.append(
                f"{now:7.2f} s  {pan:6.2f} {tilt:6.2f} {error:5.1f} {self._state[:60]}"
            )
        for index, position in enumerate(positions):
            self._check(index, position, BESIDE, "is at")

    def _check(self, index: int, angle: float, tolerance: float, how: str) -> None:
        low, high = self._ways[index]
        if not low - tolerance <= angle <= high + tolerance:
            raise DidNotHoldError(
                f"{JOINTS[index].joint_name} {how} {angle:.2f} rad, where nobody commanded it to "
                f"go: the targets are at {low:.2f} to {high:.2f} rad"
            )

    def state(self) -> Iterator[str]:
        """Where the joints are, and what came to the servos last."""
        yield f"owned: {self._owners!r}, {self._state}"
        yield "the last seconds: time; pan and tilt, truly [rad]; error [degrees]; state"
        yield from self._trace
        end = time.monotonic_ns()
        for write in self._newest:
            goal = JOINTS[write.id - 1].position(write.goal)
            yield f"{(write.time - end) * 1e-9:7.2f} s: {write}, goal {goal:.2f} rad"

    def wait(self, seconds: float) -> None:
        """Lets time pass, and looks."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            time.sleep(min(0.02, left))
            self.look()

    def until(self, what: Callable[[], bool], limit: float, name: str) -> float:
        """How long it took until something was so [s].

        Raises:
            DidNotHoldError: longer than `limit` [s] and what the machine lost.
        """
        start, waited = time.monotonic(), waited_for_a_core()
        while not what():
            self.look()
            taken = time.monotonic() - start
            if taken > limit + waited_for_a_core() - waited:
                raise DidNotHoldError(f"{name}: not within {limit:g} s")
            time.sleep(0.005)
        return time.monotonic() - start

    # Blows

    def note(self, text: str) -> None:
        self.journal.append(f"{time.monotonic() - self._start:7.2f} s  {text}")

    def strike(self) -> None:
        """One blow."""
        blows: list[tuple[int, Callable[[], None]]] = [
            (3, self.kill),
            (1, self.terminate),
            (2, self.freeze),
            (3, self.unplug),
            (3, self.flood_targets),
            (3, self.flood_commands),
            (2, self.foreign_commands),
            (2, self.foreign_parameters),
            (2, self.second_robot),
            (3, self.stop),
            (1, self.stop_without_adapter),
        ]
        if self._seconds >= LONG:
            blows.append((1, self.second_run))
        if self.clock:
            blows.append((3, self.jump))
        weights, strikes = zip(*blows, strict=True)
        blow = self.random.choices(strikes, weights)[0]
        self.struck[blow.__name__] += 1
        blow()
        self.look()

    def kill(self) -> None:
        """A process is killed and started again."""
        self._restart(signal.SIGKILL)

    def terminate(self) -> None:
        """A process is ended and started again."""
        self._restart(signal.SIGTERM)

    def kill_bus(self) -> None:
        """The servo bus of a stopped head is killed and started again."""
        self._stopped_by_bus = False  # the new one says what it knows
        self._restart(signal.SIGKILL, "servo_bus")
        self.until(lambda: self._stopped_by_bus, START_LIMIT, "the new servo bus is stopped, too")

    def _restart(self, number: signal.Signals, name: str = "") -> None:
        program = self.programs[name or self.random.choice(sorted(self.programs))]
        self.note(f"{program.name} {number.name}")
        program.signal(number)
        if number == signal.SIGTERM:
            self.until(lambda: not program.alive, 8.0, f"{program.name} ends by SIGTERM")
        else:
            self.wait(self.random.uniform(0.0, 0.6))
        program.end()
        program.start()

    def freeze(self) -> None:
        """A process stands still for a while."""
        program = self.programs[self.random.choice(sorted(self.programs))]
        seconds = self.random.uniform(0.1, 1.0)
        self.note(f"{program.name} stands still for {seconds:.2f} s")
        program.signal(signal.SIGSTOP)
        self.wait(seconds)
        program.signal(signal.SIGCONT)

    def unplug(self) -> None:
        """The adapter is pulled out and plugged in again."""
        self.until(self.complete, START_LIMIT, "the robot is complete")  # none starts without it
        seconds = self.random.uniform(0.05, 1.0)
        self.note(f"unplugged for {seconds:.2f} s")
        self.port.close()
        self.wait(seconds)
        self.port.open()

    def jump(self) -> None:
        """The robot's clock jumps."""
        by = self.random.choice((-1.0, 1.0)) * 10.0 ** self.random.uniform(-1.0, 4.0)
        self.note(f"the clock jumps by {by:.2f} s")
        self._offset += by
        self.wait(0.05)

    def flood_targets(self) -> None:
        """Points that nobody can look at, as fast as they can be published."""
        self._flood("targets")

    def flood_commands(self) -> None:
        """Commands that no joint can obey, as fast as they can be published."""
        self._flood("commands")

    def _flood(self, what: str) -> None:
        seconds = self.random.uniform(0.1, 0.5)
        self.note(f"flood of {what} for {seconds:.2f} s")
        self._flooder.tell(f"{what} {seconds} {self.random.random()}")
        self.wait(0.1 + seconds)

    def foreign_commands(self) -> None:
        """Somebody else commands joints that the tracker owns."""
        if not (self.complete() and self.owned()):  # one that is just starting may lose its lease
            return
        self.note("a foreigner commands the joints")
        message = JointState(name=[joint.joint_name for joint in JOINTS])
        message.position, message.velocity = [FOREIGN, 0.0], [1.0, 1.0]
        publisher = self.node.create_publisher(JointState, "joint_commands", 10)
        try:
            for _ in range(50):
                publisher.publish(message)
                self.wait(0.01)
        finally:
            self.node.destroy_publisher(publisher)

    def owned(self) -> bool:
        """Whether the tracker owns all joints, and is there."""
        lines = [line for line in self._owners.splitlines() if line.strip()]
        return bool(lines) and all("head_tracker" in line for line in lines)

    def foreign_parameters(self) -> None:
        """A node with a parameter that has no value comes and goes."""
        self.note("a node with a parameter without value")
        node = Node(f"driver_{self.random.randrange(1000)}")
        node.declare_parameter("empty", descriptor=ParameterDescriptor(dynamic_typing=True, type=0))
        node.declare_parameter("number", 1.0)
        self.wait(self.random.uniform(0.05, 0.3))
        node.destroy_node()

    def second_robot(self) -> None:
        """Another robot in a namespace of its own commands its own head."""
        self.note("a second robot in a namespace of its own")
        node = Node("head_tracker", namespace="other")
        commands = node.create_publisher(JointState, "joint_commands", 10)
        states = node.create_publisher(JointState, "joint_states", 10)
        message = JointState(name=[joint.joint_name for joint in JOINTS])
        message.position = [FOREIGN, 0.0]
        for _ in range(20):
            commands.publish(message)
            states.publish(message)
            self.wait(0.01)
        node.destroy_node()

    def second_run(self) -> None:
        """A colleague tries the simulation in the same ROS domain."""
        self.note("a colleague's --sim")
        colleague = Program(
            "colleague",
            ["-m", "head_tracking", "--sim", "--duration", "2"],
            self._folder / "colleague.log",
        )
        colleague.start()
        try:
            self.until(lambda: not colleague.alive, START_LIMIT, "the colleague's --sim ends")
        finally:
            colleague.end()

    # STOP

    def has_bus(self) -> bool:
        """Whether somebody reads the servos, and can be asked to stop."""
        return self.stop_client.service_is_ready() and self.reads()

    def reads(self) -> bool:
        """Whether joint states come."""
        return time.monotonic() - self._joints_heard < 0.2

    def stop(self) -> None:
        """STOP, in the midst of whatever happens."""
        self.until(self.has_bus, START_LIMIT, "the bus comes")
        self.until(lambda: self.error() < ON_TARGET, START_LIMIT, "the head is on its target")
        self.note("STOP")
        answers = self._ask_to_stop()

        def relaxed() -> bool:
            answers()
            return self.relaxed()

        taken = self.until(relaxed, STOP_LIMIT, "STOP relaxes")
        self.slowest_stop, self.stops = max(self.slowest_stop, taken), self.stops + 1
        self.until(lambda: any(answer.success for answer in answers()), 2.0, "STOP is confirmed")
        self._lift_after_a_while()

    def _ask_to_stop(self) -> Callable[[], list[Any]]:
        """Asks every 0.1 s until it is confirmed, as whoever means it does; the answers.

        (A request is lost if it is sent before the two ends of a new service have found each
        other; and a servo that is just coming back confirms nothing.)
        """
        futures: list[Any] = []

        def answers() -> list[Any]:
            done = [future.result() for future in futures if future.done()]
            confirmed = any(answer.success for answer in done)
            if not confirmed and (not futures or time.monotonic() > asked[-1] + 0.1):
                futures.append(self.stop_client.call_async(Trigger.Request()))
                asked.append(time.monotonic())
            return done

        asked: list[float] = []
        answers()
        return answers

    def stop_without_adapter(self) -> None:
        """STOP while the adapter is out: the servos are relaxed as soon as it is back."""
        self.until(self.complete, START_LIMIT, "the robot is complete")
        self.until(self.has_bus, START_LIMIT, "the bus comes")
        self.note("STOP while the adapter is out")
        self.port.close()
        self.wait(self.random.uniform(0.0, 0.3))
        answers = self._ask_to_stop()
        self.until(lambda: bool(answers()), 2.0, "STOP answers without an adapter")
        if any(answer.success for answer in answers()) and not self.relaxed():
            raise DidNotHoldError("STOP is confirmed, but the servos are not relaxed")
        self.look()
        self.port.open()
        self.until(self.relaxed, 3.0, "STOP relaxes when the adapter is back")
        self._lift_after_a_while()

    def _lift_after_a_while(self) -> None:
        self.look()
        self._stopped = True
        blows = [self.flood_targets, self.flood_commands, self.unplug]
        if "servo_bus" in self.programs:  # the others remember the STOP
            blows.append(self.kill_bus)
        for _ in range(self.random.randrange(3)):
            self.random.choice(blows)()
        self.wait(self.random.uniform(0.2, 0.6))
        self.look()
        self._stopped = False
        self.note("resume")
        self.until(self.resume_client.service_is_ready, START_LIMIT, "resume is there")
        self._call(self.resume_client, Trigger.Request())
        self._enable()

    def _call(self, client: Any, request: Any) -> None:
        """Calls until it is granted, as a person does whose servos were just missing."""
        future = client.call_async(request)
        asked, told = time.monotonic(), ""

        def granted() -> bool:
            nonlocal future, asked, told
            if future.done():
                told = future.result().message
                if future.result().success:
                    return True
            if time.monotonic() > asked + 0.5:
                future, asked = client.call_async(request), time.monotonic()
            return False

        try:
            self.until(granted, 5.0, f"{client.srv_name} is granted")
        except DidNotHoldError as error:
            raise DidNotHoldError(f"{error}: {told!r}") from None

    def _enable(self) -> None:
        self.until(self.enable_client.service_is_ready, START_LIMIT, "head_tracker is there")
        self._call(self.enable_client, SetBool.Request(data=True))

    # The whole

    def complete(self) -> bool:
        """Whether everything is there, and what was started anew has found the others.

        (How long that takes is the middleware's affair: now and then some seconds. The graph still
        names for a while what was killed, so a sign of life is waited for.)
        """
        dead = [program.name for program in self.programs.values() if not program.alive]
        if dead:
            raise DidNotHoldError(f"{', '.join(dead)} ended by itself")
        started = {name: program.started for name, program in self.programs.items()}
        robot = max(started[name] for name in started if name != "page")
        tracker = started.get("run", started.get("head_tracker", 0.0))
        return robot < self._recovered or (
            self._joints_heard > robot
            and self._state_heard > tracker
            and not (self._targets and self._state.startswith(("idle", "stalled")))
            and self.stop_client.service_is_ready()
        )

    def run(self, seconds: float) -> None:
        """Waits for the robot, strikes it, and lets it recover, again and again.

        Raises:
            DidNotHoldError: something did not hold.
        """
        self.until(self.complete, START_LIMIT, "the robot starts")
        self.quiet()
        self._commanded = self._targets = True
        self.until(lambda: self.error() < ON_TARGET, START_LIMIT, "the head finds its target")
        self._seconds = seconds
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            for _ in range(self.random.randrange(1, 4)):
                self.strike()
                self.wait(self.random.uniform(0.0, 0.4))
            self.until(self.complete, START_LIMIT, "the robot is complete again")
            self.note("the last blow")
            taken = self.until(
                lambda: self.error() < ON_TARGET and not self.relaxed(),
                RECOVERY_LIMIT,
                f"the head is on its target again (error now {math.degrees(self.error()):.0f}°)",
            )
            self.note(f"on the target again after {taken:.2f} s")
            self.slowest_recovery = max(self.slowest_recovery, taken)
            self.recoveries += 1
            self._recovered = time.monotonic()
            self.wait(0.3)

    def quiet(self) -> None:
        """Before anybody commands anything, nothing can make the servos move."""
        for _ in range(2):
            self.random.choice((self.flood_targets, self.flood_commands, self.unplug))()
            self.wait(0.1)


def _stamp(seconds: float) -> Time:
    whole = math.floor(seconds)
    return Time(sec=max(0, min(whole, 2**31 - 1)), nanosec=int((seconds - whole) * 1e9))


def main() -> int:
    """Strikes one robot; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--run", choices=("composed", "nodes"), default="composed")
    parser.add_argument("--clock", action="store_true")
    parser.add_argument("--flood", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.flood:
        flood()
        return 0
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    with ExitStack() as resources:
        os.environ["ROS_DOMAIN_ID"] = resources.enter_context(own_domain())
        folder = Path(resources.enter_context(tempfile.TemporaryDirectory()))
        chaos = Chaos(options.seed, options.run, options.clock, folder)
        chaos.set_up(resources)
        try:
            chaos.run(options.seconds)
        except DidNotHoldError as error:
            repeat = f"--seed {options.seed} --seconds {options.seconds:g} --run {options.run}"
            print(f"chaos {repeat}{' --clock' * options.clock}: {error}", file=sys.stderr)
            print(*chaos.journal[-40:], *chaos.state(), sep="\n", file=sys.stderr)
            for log in sorted(folder.glob("*.log")):
                lines = log.read_text(errors="replace").splitlines()
                lines = [line for line in lines if "| bus " not in line]
                print(f"--- {log.name}", *lines[-25:], sep="\n", file=sys.stderr)
            return 1
        print(
            json.dumps(
                {
                    "struck": chaos.struck,
                    "stops": chaos.stops,
                    "slowest_stop": round(chaos.slowest_stop, 3),
                    "recoveries": chaos.recoveries,
                    "slowest_recovery": round(chaos.slowest_recovery, 3),
                }
            )
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
