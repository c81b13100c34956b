"""Programs with ROS: they announce themselves, and however they end, they end."""

import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import closing
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest
import rclpy
from rclpy.node import Node
from rig import Talker, own_domain, run_python
from std_msgs.msg import String
from waiting import PATIENCE, wait_for

from head_tracking.ros.kit import spinning
from head_tracking.ros.kit.spinning import start_ros, steady_timer
from head_tracking.ros.kit.stop_signal import ENDING, StopSignal
from head_tracking.ros.kit.threads import NodeThread, PolledNode, UrgentServices, Worker
from head_tracking.ros.kit.topics import TopicListener

PROGRAM = Path(__file__).parents[1] / "support" / "exit_paths.py"

HANGING = """
import sys, time
from head_tracking.ros.kit.stop_signal import StopSignal
from head_tracking.run import child
child._END_TIMEOUT = 1
with StopSignal() as stop:
    child.SupervisorLink(int(sys.argv[1]), stop)
    time.sleep(120)
"""

# what the program does before its end, and whether that is an error of its own
WAYS = [
    ("own", 0),
    ("node error", 1),
    ("node shutdown destroy", 0),
    ("own drop", 0),
    ("node unregister shutdown", 0),
    ("own wait", 0),
    ("node busy", 0),
    ("node interrupt sleeping", -2),
    ("node spin", 0),
]


@pytest.mark.parametrize(("way", "code"), WAYS, ids=[way for way, _ in WAYS])
def test_a_program_ends(way, code):
    ended = run_python(str(PROGRAM), way)
    assert ended.returncode == code, ended.stderr
    assert ended.stderr.count("Traceback") == (code != 0), ended.stderr


def test_timers_are_restarted_after_a_step_back_of_the_systems_clock(threads, start, monkeypatch):
    """They are steady, but the wheels of rclpy wait for them by that clock."""
    node, restarted = start(Node("ticks")), []
    for name in ("running", "cancelled"):
        timer = steady_timer(node, 1000.0, list)
        monkeypatch.setattr(timer, "reset", lambda name=name: restarted.append(name))
    timer.cancel()
    steps = iter([0.0, 0.05, 3600.0, 3600.0, 0.0, 0.0])
    clocks = SimpleNamespace(monotonic=time.monotonic, time=lambda: time.monotonic() + next(steps))
    monkeypatch.setattr(spinning, "time", clocks)
    with pytest.raises(StopIteration):
        threads.wait(StopSignal(), PATIENCE)
    assert {*restarted} == {"running"}


def test_a_process_that_hangs_ends_after_its_supervisor():
    supervisor, channel = socket.socketpair(type=socket.SOCK_SEQPACKET)
    hanging = subprocess.Popen(
        [sys.executable, "-c", HANGING, str(channel.fileno())], pass_fds=[channel.fileno()]
    )
    try:
        channel.close()
        supervisor.close()
        assert hanging.wait(PATIENCE) == -signal.SIGALRM
    finally:
        hanging.kill()


BUSY = """
import time
from head_tracking.ros.kit import spinning

spinning._PATIENCE = 0.5

class Busy(spinning.ClosingNode):
    def __init__(self):
        super().__init__("busy")
        self.create_timer(0.05, self.work)

    def work(self):
        print("works", flush=True)
        while True:
            time.sleep(0.01)

code = spinning.run_node(Busy)
print("ended")
raise SystemExit(code)
"""


def test_a_program_whose_callback_does_not_return_ends_without_being_aborted():
    busy = subprocess.Popen(
        [sys.executable, "-c", BUSY], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert busy.stdout.readline() == "works\n"
        busy.send_signal(signal.SIGINT)
        assert busy.communicate(timeout=PATIENCE) == ("ended\n", "a callback does not return\n")
        assert busy.returncode == 1
    finally:
        busy.kill()


INTERRUPTED = """
import signal, sys
from head_tracking.ros.kit.stop_signal import StopSignal

def interrupt(frame, event, argument):
    global left
    left -= event == "line"
    if left == 0:
        signal.raise_signal(signal.SIGINT)
    return interrupt

for line in range(1, 60):  # of `wait` and of what it calls
    with StopSignal() as stop:
        left = line
        wait = stop.wait
        sys.settrace(interrupt)
        while not wait(0.001):
            pass
        sys.settrace(None)
        assert stop() and wait(5.0)
print("ended")
"""


def test_a_signal_is_noticed_in_every_line_of_the_wait_for_it():
    assert run_python("-c", INTERRUPTED).stdout == "ended\n"


def test_a_process_of_a_run_that_still_imports_ends_at_once():
    ours, theirs = socket.socketpair(type=socket.SOCK_SEQPACKET)
    command = [sys.executable, "-m", "head_tracking.run.child", "control", str(theirs.fileno())]
    with ours, theirs:
        before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
        process = subprocess.Popen([*command, "--sim"], pass_fds=[theirs.fileno()])
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE) == 0
        theirs.close()
        assert ours.recv(100) == b""  # what has run reports its end


ANNOUNCED = """
import sys
from rclpy.node import Node
from head_tracking.ros.kit.spinning import start_ros
start_ros(["program"])
node = Node("announced")
sys.stdin.read()
"""
NUMBER = 31  # of a process in its domain; it is said to the first 32 on the machine
INITIAL = 6  # announcements that Fast DDS makes within half a second


def test_a_program_says_often_that_it_is_there():
    with own_domain() as domain, socket.socket(type=socket.SOCK_DGRAM) as hears:
        hears.bind(("127.0.0.1", 7400 + 250 * int(domain) + 10 + 2 * NUMBER))
        hears.settimeout(PATIENCE)
        settings = {
            "ROS_DOMAIN_ID": domain,
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
            "FASTRTPS_DEFAULT_PROFILES_FILE": "",
            "FASTDDS_DEFAULT_PROFILES_FILE": "",
        }
        command = [sys.executable, "-c", ANNOUNCED]
        with subprocess.Popen(command, env=os.environ | settings, stdin=subprocess.PIPE):
            heard = []
            while len(heard) < INITIAL + 4:
                assert hears.recv(1 << 16).startswith(b"RTPS")
                heard.append(time.monotonic())
    assert heard[-1] - heard[-4] < 6.0  # s; by default it is 9


def test_a_users_own_settings_of_fast_dds_are_left_alone(monkeypatch, tmp_path):
    mine = tmp_path / "mine.xml"
    mine.write_text("<?xml version='1.0'?><dds><profiles/></dds>")
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(mine))
    monkeypatch.delenv("FASTDDS_DEFAULT_PROFILES_FILE", raising=False)
    start_ros(["program"])
    rclpy.try_shutdown()
    assert os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] == str(mine)
    assert "FASTDDS_DEFAULT_PROFILES_FILE" not in os.environ


def test_the_nodes_of_a_program_that_is_renamed_have_different_names():
    context = rclpy.Context()
    rclpy.init(args=["--ros-args", "-r", "__node:=page"], context=context)
    try:
        node = Node("viewer", context=context)
        others = PolledNode(node, "polled"), NodeThread.beside(node, "stop").node
        names = [each.get_name() for each in (node, *others)]
    finally:
        context.try_shutdown()
    assert names == ["page", "page_polled", "page_stop"]


def test_an_error_of_a_worker_ends_the_node_by_its_next_offer():
    def work(_):
        raise KeyError("broken")

    def offered():
        try:
            worker.offer(1)
        except KeyError:
            return True
        return False

    with closing(Worker("work", work)) as worker:
        wait_for(offered)


def test_a_worker_keeps_the_order_of_what_is_delayed_when_the_delay_becomes_shorter():
    done = []
    with closing(Worker("work", done.append)) as worker:
        for image, delay in ((1, 0.1), (2, 0.05), (3, 0.0)):
            worker.do(partial(done.append, image), delay)
        worker.do(partial(done.append, 0))
        wait_for(lambda: len(done) == 4)
    assert done == [0, 1, 2, 3]


def test_an_error_of_an_urgent_service_is_an_answer_without_success(threads):
    def fail(request):
        raise RuntimeError

    person, bus = Talker(Node("person")), Node("bus")
    threads.start(person.node)
    with closing(UrgentServices(bus)) as services:
        services.offer("fail", fail)
        services.start()
        for _ in range(2):
            assert not person.call("fail").success


# Publishes one message on each topic, as soon as somebody listens, and stays for their delivery.
PERSON = """
import sys, time, rclpy
from std_msgs.msg import String
rclpy.init()
node = rclpy.create_node("person")
for topic in sys.argv[1:]:
    publisher = node.create_publisher(String, topic, 10)
    while not publisher.get_subscription_count():
        time.sleep(0.001)
    publisher.publish(String(data=topic))
sys.stdin.read()
"""


def test_the_only_message_of_a_new_publisher_is_received(bench):
    topics, heard = [f"topic_{number}" for number in range(60)], []
    for topic in topics:
        TopicListener(bench.person.node, String, topic, lambda message: heard.append(message.data))
    with subprocess.Popen(
        [sys.executable, "-c", PERSON, *topics],
        env=os.environ | {"ROS_DOMAIN_ID": bench.domain},
        stdin=subprocess.PIPE,
    ):
        wait_for(lambda: sorted(heard) == sorted(topics))
