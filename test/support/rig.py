"""A head as a user meets it: executables, ROS names, and simulated servos behind a port."""

import fcntl
import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cached_property
from pathlib import Path
from typing import Any

import rclpy
from geometry_msgs.msg import Point, PointStamped
from rcl_interfaces.msg import Log, Parameter, ParameterDescriptor, SetParametersResult
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.exceptions import InvalidHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter as ParameterValue
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64, String
from std_srvs.srv import SetBool, Trigger
from waiting import PATIENCE, at_rest, join, wait_for

from head_tracking import Head
from head_tracking.simulation import SimulatedPort, SimulatedServo

SOURCE = Path(__file__).resolve().parents[2]
# the libraries of a colcon workspace and of a sourced ROS are on the path, too
PYTHONPATH = os.pathsep.join(filter(None, [str(SOURCE), os.getenv("PYTHONPATH")]))
_RETRY = 5.0  # s
LOCKS = Path("/tmp")  # as the locks of heads: not TMPDIR, which may differ between test runs
JOINTS = ("head_pan_joint", "head_tilt_joint")
# deep enough for states that last only for a moment
LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
DEGREE = math.radians(1.0)
TICK = math.radians(300.0) / 1024  # rad, of an AX-12


@contextmanager
def own_domain() -> Iterator[str]:
    """A ROS domain that is this test's own until the end: heads that share one refuse to run.

    The ports of domains above 100 are among those that Linux gives to any socket.
    """
    for number in range(100, 50, -1):
        place = LOCKS / f"head_tracking_test_domain_{number}"
        with suppress(PermissionError):  # another user has made it
            place.touch()
        with place.open() as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            os.set_inheritable(lock.fileno(), True)  # while a program of the test lives, too
            yield str(number)
            return
    raise RuntimeError("no ROS domain from 51 to 100 is free: another test run holds them")


def child(pid: int, name: str) -> int:
    """Return the process id of control, vision or page; 0 if there is none."""
    for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
        try:
            words = Path(f"/proc/{word}/cmdline").read_bytes().split(b"\0")
        except OSError:
            continue  # it has just ended
        if name.encode() in words[:5]:
            return int(word)
    return 0


def has_ended(pid: int) -> bool:
    """Return whether a process has ended, though nobody may have waited for it."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return True
    return state == "Z"


def bearing(x: float, y: float) -> float:
    """Return the pan angle at which Kinectbot looks at a point of base_link [rad]."""
    return math.atan2(y, x - 0.0115)


def command(name: str) -> list[str]:
    """Return the words that start an executable, or a file of Python."""
    if name.endswith(".py"):
        return [sys.executable, name]
    words = [sys.executable, "-u", "-m", "head_tracking"]
    return words if name == "head_tracking" else [*words, name]


def run_python(*words: str, text: str = "", **environment: str) -> subprocess.CompletedProcess[str]:
    """Run Python with these words and this input to its end."""
    given = os.environ | {"PYTHONPATH": PYTHONPATH} | environment
    command = [sys.executable, *words]
    return subprocess.run(
        command, input=text, env=given, capture_output=True, text=True, timeout=120, check=False
    )


class Program:
    """An executable that runs."""

    def __init__(
        self,
        name: str,  # of the executable
        *arguments: str,  # of its command line
        domain: str,  # of ROS
        own_group: bool = False,  # it gets a process group of its own, which `kill` kills
        # over this process's and the defaults; None: without the variable
        environment: dict[str, str | None] | None = None,
        stdout: Any = None,  # where its output goes; None: to `output`
    ) -> None:
        self._name, self._own_group = " ".join((name, *arguments)), own_group
        given = os.environ | {
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_DOMAIN_ID": domain,
            "PYTHONPATH": PYTHONPATH,
        }
        given |= environment or {}
        self.process = subprocess.Popen(
            # nohup, and a shell's &, have signals ignored
            ["env", "--default-signal", *command(name), *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE if stdout is None else stdout,
            stderr=subprocess.STDOUT,
            text=True,
            env={name: value for name, value in given.items() if value is not None},
            start_new_session=own_group,
            close_fds=False,
        )
        self.output = ""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        for line in self.process.stdout or ():
            self.output += line

    @property
    def last_line(self) -> str:
        return (self.output.splitlines() or [""])[-1]

    def read_until(self, words: str) -> str:
        """Wait for a line with these words and return it."""

        def found() -> str:
            ended = not self._reader.is_alive()  # first: its last lines come after its end
            lines = [line for line in self.output.splitlines() if words in line]
            assert lines or not ended, f"ended without {words!r}:\n{self.output}"
            return lines[0] if lines else ""

        return wait_for(found, why=lambda: self.output)

    def end(self, number: signal.Signals | None = None) -> int:
        """Return the exit code, after a signal or by itself; no program shows a traceback."""
        if number is not None:
            self.process.send_signal(number)
        code = self.process.wait(PATIENCE)
        join(self._reader)
        assert "Traceback" not in self.output, self.output
        return code

    def kill(self) -> None:
        if self._own_group:
            with suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGKILL)
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait(PATIENCE)
        join(self._reader)  # until its children have ended, too: they have the lock of a head
        if self.process.stdout is not None:
            self.process.stdout.close()
        print(f"{self._name}:\n{self.output}", file=sys.stderr)  # shown if the test fails


class Servos:
    """Two AX-12 with the ids 1 (pan) and 2 (tilt) behind a port; they belong to no program."""

    def __init__(self, link: Path) -> None:
        self.port = SimulatedPort([SimulatedServo(1), SimulatedServo(2)], link=link)
        self.port.open()
        self.close = self.port.close

    @property
    def name(self) -> str:
        return self.port.port_name

    def register(self, servo: int, name: str) -> int:
        return self.port.use(lambda bus: bus[servo].register(name))

    @property
    def torque(self) -> list[int]:
        return [self.register(servo, "Torque Enable") for servo in (1, 2)]

    @property
    def ticks(self) -> tuple[float, float]:
        """Where pan and tilt really are [ticks]."""
        return self.port.use(lambda bus: (bus[1].true_ticks, bus[2].true_ticks))

    @property
    def true(self) -> tuple[float, float]:
        """Where pan and tilt really are [rad]."""
        pan, tilt = self.ticks
        return TICK * (pan - 512), TICK * (tilt - 512)

    def turn_by_hand(self, servo: int, position: float) -> None:
        """Lead a shaft to a position [rad] within half a second."""
        self.port.use(lambda bus: bus[servo].lead(512 + position / TICK, 0.5))

    def at_rest(self) -> tuple[float, float]:
        """Wait until both shafts have stood still for 0.3 s; where [rad]."""
        return at_rest(lambda: self.true, 0.3)


def follow_a_swing(head: Head) -> None:
    """Follow a target that swings, for a moment."""
    now = time.time()
    swing = 0.7 * math.sin(1.5 * now)
    head.follow((2 * math.cos(swing), 2 * math.sin(swing), 0.6), stamp=now)
    time.sleep(0.02)


def swing_until_learned(head: Head, value: str) -> None:
    """Follow a target that swings, until a head has learned a value."""
    wait_for(lambda: follow_a_swing(head) or head.learned[value].source == "learned")


class Talker:
    """Sees and asks only by ROS names, with a node of this process that somebody spins."""

    def __init__(self, node: Node, namespace: str = "") -> None:
        self._namespace = namespace
        self.node = node
        self._heard: dict[str, list[Any]] = {}
        self._publishers: dict[str, Any] = {}
        self._clients: dict[str, Any] = {}
        self.measured: dict[str, tuple[float, float]] = {}  # stamp [s] and position, by joint
        self.log: list[Log] = []
        node.create_subscription(Log, "/rosout", self.log.append, 1000)
        node.create_subscription(JointState, self.name("joint_states"), self._on_joints, 10)

    def name(self, relative: str) -> str:
        return relative if relative.startswith("/") else f"{self._namespace}/{relative}"

    # what is heard

    def _on_joints(self, message: JointState) -> None:
        stamp = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
        found = zip(message.name, message.position, strict=True)
        self.measured |= {name: (stamp, position) for name, position in found}

    @property
    def pan(self) -> float:
        return self.measured[JOINTS[0]][1]

    @property
    def tilt(self) -> float:
        return self.measured[JOINTS[1]][1]

    def wait_for_joints(self) -> None:
        wait_for(lambda: set(JOINTS) <= self.measured.keys())

    def mean_speed(self, until: Callable[[], bool]) -> float:
        """Wait until something is true; return how fast pan turned, by the stamps [rad/s]."""
        began, first = self.measured[JOINTS[0]]
        wait_for(until)
        ended, last = self.measured[JOINTS[0]]
        return abs(last - first) / (ended - began)

    def wait_for_node(self, name: str) -> None:
        names = self.node.get_node_names_and_namespaces
        where = self._namespace or "/"
        wait_for(lambda: (name, where) in names())

    def looks_at(self, pan: float, tilt: float) -> bool:
        return max(abs(self.pan - pan), abs(self.tilt - tilt)) < 1.5 * DEGREE

    def hear(self, topic: str, kind: Any, qos: Any = 10) -> list[Any]:
        """Return the messages of a topic from the first call on; a list that grows."""
        name = self.name(topic)
        if name not in self._heard:
            self._heard[name] = []
            self.node.create_subscription(kind, name, self._heard[name].append, qos)
            wait_for(lambda: self.node.count_publishers(name))
        return self._heard[name]

    def latched(self, topic: str, kind: Any = String) -> Any:
        """Return the data of the latest message of a latched topic."""
        messages = self.hear(topic, kind, LATCHED)
        wait_for(lambda: messages)
        return messages[-1].data

    def state(self, node: str) -> str:
        """Return the word by which a node names its state."""
        return str(self.latched(f"{node}/state")).partition(":")[0]

    @property
    def stopped(self) -> bool:
        return bool(self.latched("stopped", Bool))

    @property
    def owners(self) -> dict[str, str]:
        """Return the owner of each joint."""
        lines = str(self.latched("joint_owners")).splitlines()
        return {joint: owner.strip() for joint, _, owner in (line.partition(":") for line in lines)}

    def complaint(self, node: str, *facts: str, of: Callable[[], object] = lambda: None) -> str:
        """Wait for a warning or an error of a node, whose name ends so, that names these facts.

        What causes it, `of`, is done again and again, for what repeats is logged once a second.
        """

        def found() -> str:
            of()
            time.sleep(0.02)
            warned = (e for e in list(self.log) if e.level >= 30 and e.name.endswith(node))
            return next((e.msg for e in warned if all(fact in e.msg for fact in facts)), "")

        return wait_for(found, why=lambda: f"{facts}: {[each.msg for each in self.log]}")

    # what is asked

    def publish(self, topic: str, message: Any) -> None:
        name = self.name(topic)
        if name not in self._publishers:
            publisher = self.node.create_publisher(type(message), name, 10)
            hearers = self.node.count_subscribers
            wait_for(lambda: publisher.get_subscription_count() >= max(1, hearers(name)))
            self._publishers[name] = publisher
        self._publishers[name].publish(message)

    def command(self, controller: str, position: float) -> None:
        self.publish(f"{controller}/command", Float64(data=float(position)))

    def point(self, x: float, y: float, z: float, frame: str = "base_link") -> PointStamped:
        """Return a target, stamped now."""
        message = PointStamped(point=Point(x=float(x), y=float(y), z=float(z)))
        message.header.frame_id = frame
        message.header.stamp = self.node.get_clock().now().to_msg()
        return message

    def look_at(self, x: float, y: float, z: float, frame: str = "base_link") -> None:
        self.publish("target_point", self.point(x, y, z, frame))

    def keep_looking(
        self, x: float, y: float, z: float, until: Callable[[], Any], frame: str = "base_link"
    ) -> None:
        """Publish a target every 30 ms until something is true."""

        def done() -> Any:
            self.look_at(x, y, z, frame)
            time.sleep(0.02)
            return until()

        wait_for(done)

    def _ask(self, kind: Any, service: str, request: Any) -> Any:
        name = self.name(service)
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, name)
        client = self._clients[name]
        wait_for(client.service_is_ready)
        futures: list[Any] = []

        def answered() -> Any:
            # An answer is lost if the server has not heard of the client yet: asked once more.
            if time.monotonic() > _RETRY * len(futures) + began:
                futures.append(client.call_async(request))
            return next((future for future in futures if future.done()), None)

        began = time.monotonic() - 1e-3
        return wait_for(answered).result()

    def call(self, service: str, data: bool | None = None) -> Any:
        if data is None:
            return self._ask(Trigger, service, Trigger.Request())
        return self._ask(SetBool, service, SetBool.Request(data=data))

    def until_done(self, service: str, data: bool | None = None) -> Any:
        """Ask until the answer is a success, and return it.

        On a busy machine simulated servos may confirm later than the service waits.
        """
        answers: list[Any] = []

        def done() -> Any:
            answers.append(self.call(service, data))
            return answers[-1] if answers[-1].success else None

        return wait_for(done, why=lambda: f"{service}: {[each.message for each in answers[-2:]]}")

    def set(self, node: str, name: str, value: Any) -> SetParametersResult:
        parameter: Parameter = ParameterValue(name, value=value).to_parameter_msg()
        request = SetParameters.Request(parameters=[parameter])
        return self._ask(SetParameters, f"{node}/set_parameters", request).results[0]

    def get(self, node: str, name: str) -> Any:
        request = GetParameters.Request(names=[name])
        (value,) = self._ask(GetParameters, f"{node}/get_parameters", request).values
        return ParameterValue.from_parameter_msg(Parameter(name=name, value=value)).value

    def descriptors(self, node: str) -> dict[str, ParameterDescriptor]:
        """Return what a node says of each of its parameters."""
        listed = self._ask(ListParameters, f"{node}/list_parameters", ListParameters.Request())
        request = DescribeParameters.Request(names=listed.result.names)
        found = self._ask(DescribeParameters, f"{node}/describe_parameters", request)
        return {descriptor.name: descriptor for descriptor in found.descriptors}


class Person(Talker):
    """Somebody at a terminal with ROS tools."""

    def __init__(self, domain: str, namespace: str = "") -> None:
        self._context = rclpy.Context()
        rclpy.init(
            context=self._context,
            domain_id=int(domain),
            signal_handler_options=SignalHandlerOptions.NO,
        )
        super().__init__(Node("person", context=self._context, enable_rosout=False), namespace)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._ending = False
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        while not self._ending:
            with suppress(InvalidHandle):  # the test has destroyed something meanwhile
                self._executor.spin_once(timeout_sec=0.1)

    def close(self) -> None:
        self._ending = True
        join(self._thread)
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()


def assert_described(person: Person, node: str) -> None:
    """Every parameter of a node has a description, and every range is one."""
    own = ("use_sim_time", "start_type_description_service", "zeros.", "qos_overrides.")
    found = person.descriptors(node)
    assert found
    for name, descriptor in found.items():
        assert descriptor.description or name.startswith(own), f"{node}.{name}"
        for bounds in descriptor.floating_point_range:
            assert bounds.from_value < bounds.to_value, f"{node}.{name}"


class Bench:
    """A ROS domain of its own, with the programs, servos and persons in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._resources = ExitStack()
        self.domain = self._resources.enter_context(own_domain())

    def close(self) -> None:
        self._resources.close()

    def start(
        self,
        name: str,
        *arguments: str,
        environment: dict[str, str | None] | None = None,
        **options: Any,
    ) -> Program:
        options["environment"] = {"XDG_STATE_HOME": str(self.folder)} | (environment or {})
        program = Program(name, *arguments, domain=self.domain, **options)
        self._resources.callback(program.kill)
        return program

    # the servos share a process with the test, and answer when that has time

    def run(self, *arguments: str, ros: tuple[str, ...] = (), **options: Any) -> Program:
        """Start a run of the head with this bench's servos."""
        ros = ("-p", "servo_bus:reply_timeout:=0.3", *ros)
        return self.start(
            "head_tracking", "--port", self.servos.name, *arguments, "--ros-args", *ros, **options
        )

    def run_bus(self, *ros: str) -> Program:
        """Start a servo bus alone, with this bench's servos."""
        # STOP waits for the port twice as long
        port = ("-p", f"port_name:={self.servos.name}", "-p", "reply_timeout:=0.1")
        return self.start("servo_bus", "--ros-args", *port, *ros)

    @cached_property
    def servos(self) -> Servos:
        servos = Servos(self.folder / "servos")
        self._resources.callback(servos.port.close)
        return servos

    @cached_property
    def person(self) -> Person:
        return self.meet("")

    def meet(self, namespace: str) -> Person:
        """Return a person who talks to the robot of a namespace."""
        person = Person(self.domain, namespace)
        self._resources.callback(person.close)
        return person
