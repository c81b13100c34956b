"""Nodes in simulated time, one event after the other: the same run every time, on any machine.

The nodes are the real ones. Only what they are connected by is replaced: topics are calls with a
delay, timers and the clock follow the simulated time, and the servos are simulated servos whose
registers are read and written 50 times a second.
"""

import heapq
import itertools
import math
from collections import defaultdict
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any
from unittest import mock

from dynamixel_fakes import PAN, TILT, speed_ticks
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.time import Time

from head_tracking.control import ControlLoop
from head_tracking.dynamixel import Goal
from head_tracking.ros.head import head_actions, head_node
from head_tracking.ros.targets import sighted_target, simulated_camera
from head_tracking.simulation import SimulatedServo
from head_tracking.tf import Buffer
from head_tracking.tracking import ClockWatch
from head_tracking.transforms import JointState, RobotModel

_START = 1_000_000_000_000  # ns
_TOPIC_DELAY = 1_000_000  # ns
_CYCLE = 20_000_000  # ns
_READ = 3_000_000  # ns from reading the servos until everybody knows, and until goals are written


class World:
    """The time, the topics and the servos of a run.

    Attributes:
        now: the time [ns].
        offset: of the clock of the nodes from `now` [ns].
        is_simulated: whether that clock is one of a simulation.
        is_measured: whether the joints are read.
        writes: number of writes of goals.
        buffer: the frames of the robot.
        allowed: limits of the servos, by joint [rad]; none: only the model's.
        heard: the messages of topics that `record` was called for.
    """

    period = _CYCLE * 1e-9

    def __init__(self, model: RobotModel | None) -> None:
        self.now, self.offset, self.writes = _START, 0, 0
        self.is_simulated, self.is_measured = False, True
        self.allowed: dict[str, tuple[float, float]] = {}
        self.buffer = Buffer()
        if model is not None:
            self.buffer.core.set_model(model)
        self.loop = ControlLoop(self.buffer.core)
        self.loop.attach(self)
        self.heard: dict[str, list[tuple[int, Any]]] = defaultdict(list)
        self._events: list[tuple[int, int, Callable[[], object]]] = []
        self._number = itertools.count()
        self._listeners: dict[str, list[Callable[[Any], object]]] = defaultdict(list)
        self.publishers: dict[str, int] = defaultdict(int)
        self._servos = {
            joint.joint_name: (joint, SimulatedServo(joint.id, joint.model, position=joint.init))
            for joint in (PAN, TILT)
        }
        self.every(_CYCLE, self._cycle)

    @property
    def seconds(self) -> float:
        """The time since the start."""
        return (self.now - _START) * 1e-9

    @property
    def stamp(self) -> int:
        """The time on the clock of the nodes [ns]."""
        return self.now + self.offset

    def at(self, when: int, what: Callable[[], object]) -> None:
        """Does something at a time [ns]."""
        heapq.heappush(self._events, (when, next(self._number), what))

    def every(self, period: int, what: Callable[[], object]) -> None:
        """Does something again and again, every `period` [ns], from now on."""

        def step() -> None:
            self.at(self.now + period, step)
            what()

        self.at(self.now + period, step)

    def listen(self, topic: str, callback: Callable[[Any], object]) -> None:
        """Calls back with every message of a topic."""
        self._listeners[topic].append(callback)

    def listeners(self, topic: str) -> int:
        return len(self._listeners[topic])

    def record(self, topic: str) -> list[tuple[int, Any]]:
        """The messages of a topic from now on, with the time they came [ns]."""
        self.listen(topic, lambda message: self.heard[topic].append((self.now, message)))
        return self.heard[topic]

    def publish(self, topic: str, message: Any) -> None:
        """Brings a message to all who listen."""
        for callback in self._listeners[topic]:
            self.at(self.now + _TOPIC_DELAY, lambda callback=callback: callback(message))

    def run(self, seconds: float) -> None:
        """Lets time pass."""
        end = self.now + round(seconds * 1e9)
        while self._events and self._events[0][0] <= end:
            self.now, _, what = heapq.heappop(self._events)
            what()
        self.now = end

    def hold_up(self, seconds: float) -> None:
        """Lets time pass for the servos only, as if the process of the nodes were stopped."""
        late = round(seconds * 1e9)
        self.now += late
        self._events = [(when + late, number, what) for when, number, what in self._events]

    def speeds(self, seconds: float, until: Callable[[], object] = lambda: None) -> list[float]:
        """Let time pass, at most until something is true; return the true speeds of pan [rad/s]."""
        speeds, end = [], self.seconds + seconds - 0.5 * self.period
        while self.seconds < end and not until():
            before = self.true_position(PAN.joint_name)
            self.run(self.period)
            speeds.append(abs(self.true_position(PAN.joint_name) - before) / self.period)
        return speeds

    def make(self, kind: type[Node], parameters: dict[str, Any], **handed: Any) -> Any:
        """A node of this world; needs an rclpy that is initialised."""
        with (
            mock.patch.object(head_node, "ClockWatch", self._clock_watch),
            mock.patch.object(head_actions, "serve_goals"),  # goals are handed over as objects
            mock.patch.object(simulated_camera, "Worker", self._worker),
            mock.patch.object(sighted_target, "Worker", self._worker),
        ):
            return _stepped(kind, self)(
                parameter_overrides=[Parameter(name, value=v) for name, v in parameters.items()],
                start_parameter_services=False,
                enable_rosout=False,
                **handed,
            )

    def _worker(self, name: str, work: Callable[[Any], object]) -> Any:
        """A thread's work is done at once, and what it does later, later."""

        def do(task: Callable[[], object], delay: float | None = None) -> None:
            if delay:
                self.at(self.now + round(delay * 1e9), task)
            else:
                task()

        return SimpleNamespace(offer=work, do=do, close=lambda: None)

    def _clock_watch(self, clock: Callable[[], float]) -> ClockWatch:
        return ClockWatch(clock, lambda: self.now * 1e-9)

    def true_position(self, joint_name: str) -> float:
        """Where a joint really is [rad]."""
        joint, servo = self._servos[joint_name]
        servo.advance(self.now)
        return joint.position(servo.true_ticks)

    @property
    def true(self) -> tuple[float, float]:
        """Where pan and tilt really are [rad]."""
        return self.true_position(PAN.joint_name), self.true_position(TILT.joint_name)

    def stop_and_resume(self, pause: float = 0.0) -> None:
        """STOP the head, and resume it after a while [s]."""
        self.loop.owners.stop(dict)
        self.run(pause)
        self.loop.owners.resume()

    def impede(self, joint_name: str, share: float) -> None:
        """Brakes a joint by this share of its servo's torque until the next call."""
        _, servo = self._servos[joint_name]
        servo.advance(self.now)
        servo.drive.impede(share)

    def claim(self) -> None:
        """See `JointBackend`."""

    def servo(self, joint: str) -> str:
        """Return nothing: what is learned is not kept."""
        return ""

    def limits(self, joint: str) -> tuple[float, float]:
        """See `JointBackend`."""
        return self.allowed.get(joint, (-math.inf, math.inf))

    def relax_now(self) -> Mapping[str, str]:
        """See `JointBackend`; the servos hold."""
        return {}

    def write(self, _: str, goals: Mapping[str, Goal], __: int) -> None:
        """See `JointBackend`."""
        self.writes += 1
        for name, goal in goals.items():
            joint, servo = self._servos[name]
            servo.advance(self.now)
            servo.set_register("Torque Enable", 1)
            servo.set_register("Goal Position", joint.ticks(goal.position))
            servo.set_register("Moving Speed", speed_ticks(joint, goal.speed))

    def _cycle(self) -> None:
        measured = {}
        for joint, servo in self._servos.values():
            servo.advance(self.now)
            position = joint.position(servo.register("Present Position"))
            measured[joint.joint_name] = JointState(position)
        if not self.is_measured:
            return
        stamp = self.stamp

        def update() -> None:
            states = self.loop.joints_read(stamp, measured)
            self.loop.update(measured)
            self.loop.publish(measured, stamp, states)

        self.at(self.now + _READ, update)


class _Clock:
    def __init__(self, world: World) -> None:
        self._world = world

    @property
    def ros_time_is_active(self) -> bool:
        return self._world.is_simulated

    def now(self) -> Time:
        return Time(nanoseconds=self._world.stamp, clock_type=ClockType.ROS_TIME)


class _Publisher:
    def __init__(self, world: World, topic: str) -> None:
        self._world = world
        self.topic_name = topic
        world.publishers[topic] += 1

    def publish(self, message: Any) -> None:
        self._world.publish(self.topic_name, message)

    def get_subscription_count(self) -> int:
        return self._world.listeners(self.topic_name)


def _stepped(kind: type[Node], world: World) -> type[Node]:
    class Stepped(kind):  # type: ignore[misc, valid-type]
        def create_publisher(self, message: type, topic: str, qos: Any, **_: Any) -> Any:
            return _Publisher(world, self.resolve_topic_name(topic))

        def create_subscription(
            self, message: type, topic: str, callback: Callable[[Any], object], *_: Any, **__: Any
        ) -> Any:
            name = self.resolve_topic_name(topic)
            world.listen(name, callback)
            return SimpleNamespace(topic_name=name, callback=callback)

        def destroy_subscription(self, subscription: Any) -> bool:
            world._listeners[subscription.topic_name].remove(subscription.callback)
            return True

        def create_timer(self, period: float, callback: Callable[[], object], **_: Any) -> Any:
            world.every(round(period * 1e9), callback)

        def count_publishers(self, topic: str) -> int:
            return world.publishers[self.resolve_topic_name(topic)]

        def get_clock(self) -> Any:
            return _Clock(world)

    return Stepped
