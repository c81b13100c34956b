"""Two heads in one graph, each a run in a namespace of its own: nothing mixes."""

import os
import subprocess
import sys
import threading
from collections import deque
from contextlib import ExitStack, closing
from pathlib import Path

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point, PointStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from robot_under_test import wait_for
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool, Trigger

SOURCE = Path(__file__).parents[2]
PATIENCE = 30.0
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
HEADS = ("left", "right")
PARAMETERS = """
/**/robot_state_publisher:
  ros__parameters: {{frame_prefix: "{prefix}"}}
/**/head_tracker:
  ros__parameters: {{camera_link: "{prefix}camera_link"}}
"""


class Head:
    """A run in a namespace, and what a person hears of it."""

    def __init__(self, name: str, prefix: str, person: Node, folder: Path) -> None:
        self.name, self.prefix = name, prefix
        self.positions: dict[str, float] = {}
        self.heard: dict[str, str] = {}
        self.stopped: bool | None = None
        self._latest: deque[float] = deque(maxlen=20)
        self._person = person
        self._target = (2.0, 0.0)
        parameters = folder / f"{name}.yaml"
        parameters.write_text(PARAMETERS.format(prefix=prefix))
        self._log = folder / f"{name}.log"
        with self._log.open("wb") as log:
            self._process = subprocess.Popen(
                [
                    *(sys.executable, "-m", "head_tracking", "--sim", "--target", "none"),
                    *("--params", parameters, "--ros-args", "-r", f"__ns:=/{name}"),
                ],
                cwd=SOURCE,
                env=os.environ | {"PYTHONPATH": os.pathsep.join([str(SOURCE), *sys.path])},
                stdout=log,
                stderr=log,
            )
        person.create_subscription(JointState, f"/{name}/joint_states", self._on_joints, 10)
        person.create_subscription(Bool, f"/{name}/stopped", self._on_stopped, LATCHED)
        for topic in ("joint_owners", "head_tracker/state", "robot_description"):
            person.create_subscription(String, f"/{name}/{topic}", self._keep(topic), LATCHED)
        self._targets = person.create_publisher(PointStamped, f"/{name}/target_point", 10)
        self._timer = person.create_timer(0.05, self._publish)

    def _on_joints(self, message: JointState) -> None:
        self.positions.update(zip(message.name, message.position, strict=True))
        self._latest.append(self.pan)

    def _on_stopped(self, message: Bool) -> None:
        self.stopped = message.data

    def _keep(self, topic):
        return lambda message: self.heard.__setitem__(topic, message.data)

    def _publish(self) -> None:
        x, y = self._target
        message = PointStamped(point=Point(x=x, y=y, z=1.0))
        message.header.frame_id = f"{self.prefix}base_link"
        message.header.stamp = self._person.get_clock().now().to_msg()
        self._targets.publish(message)

    def look_at(self, x: float, y: float) -> None:
        self._target = (x, y)

    @property
    def pan(self) -> float:
        return self.positions.get("head_pan_joint", 0.0)

    def come_to_rest(self) -> float:
        """The pan once twenty joint states agree about it: a head that is held swings back."""
        self._latest.clear()
        wait_for(self._rests, PATIENCE)
        return self.pan

    def _rests(self) -> bool:
        pans = list(self._latest)
        return len(pans) == self._latest.maxlen and max(pans) - min(pans) < 0.005

    def call(self, service: str, request):
        client = self._person.create_client(_kind(request), service)
        try:
            wait_for(client.service_is_ready, PATIENCE)
            future = client.call_async(request)
            wait_for(future.done, PATIENCE)
            return future.result()
        finally:
            self._person.destroy_client(client)

    def close(self) -> None:
        self._process.terminate()
        self._process.wait()
        print(self._log.read_text()[-3000:])


def _kind(request):
    return SetBool if isinstance(request, SetBool.Request) else Trigger


@pytest.fixture(params=["", "prefixed"], ids=["same frames", "frame_prefix"])
def heads(request, domain, monkeypatch, tmp_path):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    monkeypatch.delenv("FASTDDS_BUILTIN_TRANSPORTS", raising=False)
    context = rclpy.Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    ending = threading.Event()
    with ExitStack() as resources:
        resources.callback(context.try_shutdown)
        person = Node("person", context=context)
        found = {}
        executor = SingleThreadedExecutor(context=context)
        for name in HEADS:
            prefix = f"{name}_robot_" if request.param else ""
            found[name] = Head(name, prefix, person, tmp_path)
            resources.enter_context(closing(found[name]))
        diagnostics: dict[str, set[str]] = {}
        person.create_subscription(
            DiagnosticArray,
            "/diagnostics",
            lambda m: [diagnostics.setdefault(s.name, set()).add(s.hardware_id) for s in m.status],
            50,
        )
        executor.add_node(person)

        def spin() -> None:
            while not ending.is_set():
                executor.spin_once(timeout_sec=0.1)
            executor.shutdown()

        thread = threading.Thread(target=spin)
        thread.start()
        resources.callback(thread.join)
        resources.callback(ending.set)
        left, right = found.values()
        left.diagnostics = diagnostics
        wait_for(lambda: left.positions and right.positions, PATIENCE)
        yield left, right


def test_each_head_has_its_own_commands_owners_stop_frames_and_diagnostics(heads):
    left, right = heads

    # commands
    left.look_at(2.0, 1.0)
    right.look_at(2.0, -1.0)
    wait_for(lambda: left.pan > 0.3 and right.pan < -0.3, PATIENCE)

    # owners
    for head in heads:
        owners = head.heard["joint_owners"]
        assert owners.count(f"/{head.name}/head_tracker") == 2, owners
    off = left.call("/left/head_tracker/enable", SetBool.Request(data=False))
    assert off.success, off.message
    wait_for(lambda: "head_tracker" not in left.heard["joint_owners"], PATIENCE)
    assert right.heard["joint_owners"].count("/right/head_tracker") == 2

    # one rests, the other goes on
    rest = left.come_to_rest()
    left.look_at(2.0, -1.0)
    right.look_at(2.0, 1.0)
    wait_for(lambda: right.pan > 0.3, PATIENCE)
    assert left.pan == pytest.approx(rest, abs=0.05)

    # STOP
    on = left.call("/left/head_tracker/enable", SetBool.Request(data=True))
    assert on.success, on.message
    wait_for(lambda: left.pan < -0.3, PATIENCE)
    stopped = left.call("/left/stop", Trigger.Request())
    assert stopped.success, stopped.message
    wait_for(lambda: left.stopped, PATIENCE)
    left.look_at(2.0, 1.0)
    right.look_at(2.0, -1.0)
    wait_for(lambda: right.pan < -0.3, PATIENCE)
    assert left.pan < -0.3
    assert right.stopped is False

    # frames
    for head in heads:
        tree = head.call(f"/{head.name}/robot_state_publisher/frames", Trigger.Request()).message
        assert f"{head.prefix}camera_link" in tree

    # diagnostics
    wait_for(lambda: all(_told(left.diagnostics, head.name) for head in heads), PATIENCE)
    unclaimed = [n for n in left.diagnostics if not any(_of(n, head.name) for head in heads)]
    assert not unclaimed


def _of(name: str, head: str) -> bool:
    return name.lstrip("/").startswith(f"{head}/")


def _told(diagnostics: dict[str, set[str]], head: str) -> bool:
    names = [name for name in diagnostics if _of(name, head)]
    return any("head_tracker" in name for name in names) and len(names) > 1
