"""Killed processes of a run: the servos are relaxed, or the process is restarted."""

import errno
import json
import os
import random
import re
import resource
import signal
import threading
import time
import urllib.request
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

import pytest
from rig import LATCHED, PYTHONPATH, child, has_ended, run_python
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from waiting import PATIENCE, wait_for

from head_tracking.dynamixel import servo_model
from head_tracking.simulation import SimulatedPort, SimulatedServo

needs_opencv = pytest.mark.skipif(
    find_spec("cv2") is None, reason="needs OpenCV: pip install -r requirements/vision.txt"
)


def under_way(bench, *arguments):
    """Return a run that follows a target, at a random moment."""
    run = bench.run("--target", "smooth", *arguments)
    wait_for(lambda: bench.servos.torque == [1, 1])
    time.sleep(random.uniform(0.0, 0.7))
    return run


def test_the_servos_are_relaxed_when_control_is_killed(bench):
    """One that was found later as well."""
    bench.servos.port.use(lambda bus: bus[2].power_off())
    run = bench.run("--target", "smooth", ros=("-p", "servo_bus:allow_missing:=true"))
    states = bench.person.hear("servo_states", JointState)
    wait_for(lambda: states)
    assert list(states[-1].name) == ["head_pan_joint"]
    bench.servos.port.use(lambda bus: bus[2].power_on())
    wait_for(lambda: bench.servos.torque == [1, 1])
    time.sleep(random.uniform(1.0, 1.7))  # control reports new servos every 0.1 s
    os.kill(child(run.process.pid, "control"), signal.SIGKILL)
    assert run.end() == 1, run.output
    assert bench.servos.torque == [0, 0]
    assert "SIGKILL" in run.output


def loads_no_more_than_it_needs(run):
    """ROS in the supervisor, parser or cryptography in control: a fifth of control's memory."""
    assert "rclpy" not in Path(f"/proc/{run.process.pid}/maps").read_text()
    libraries = Path(f"/proc/{child(run.process.pid, 'control')}/maps").read_text()
    assert "/numpy/" in libraries and "rclpy" in libraries
    return not any(x in libraries for x in ("lxml", "pyexpat", "_hashlib", "cv2", "scipy/"))


def test_the_servos_hold_after_a_crash_with_on_crash_hold(bench):
    run = under_way(bench, "--on-crash", "hold")
    bench.person.wait_for_joints()
    assert loads_no_more_than_it_needs(run)
    os.kill(child(run.process.pid, "control"), signal.SIGKILL)
    assert run.end() == 1, run.output
    assert bench.servos.torque == [1, 1]
    bench.servos.at_rest()


@pytest.mark.parametrize("moment", ["at once", "under way"])
def test_the_servos_are_relaxed_and_all_processes_end_when_the_supervisor_is_killed(bench, moment):
    run = under_way(bench) if moment == "under way" else bench.run("--target", "smooth")
    control = wait_for(lambda: child(run.process.pid, "control"))
    run.process.kill()
    wait_for(lambda: has_ended(control))
    assert bench.servos.torque == [0, 0]


def test_servos_with_a_bus_watchdog_stop_when_control_and_supervisor_are_killed_at_once(bench):
    """Nobody is left who could relax them: they stop on their way, with torque on."""
    model = "XM430-W350"
    values = {"motor.model": model, "motor.init": 2048, "motor.min": 1024, "motor.max": 3072}
    rules = [
        f"servo_bus:{name}_controller.{key}:={value}"
        for name in ("head_pan", "head_tilt")
        for key, value in {**values, "joint_speed": 0.2}.items()
    ]
    with SimulatedPort([SimulatedServo(i, servo_model(model)) for i in (1, 2)]) as port:
        words = "--port", port.port_name, "--target", "none", "--without", "head"
        rules = [word for rule in rules for word in ("-p", rule)]
        run = bench.start("head_tracking", *words, "--ros-args", *rules)
        bench.person.wait_for_joints()
        wait_for(lambda: bench.person.command("head_pan_controller", 1.4) or bench.person.pan > 0.1)
        os.kill(child(run.process.pid, "control"), signal.SIGKILL)
        run.process.kill()

        def state():
            names = "Bus Watchdog", "Torque Enable", "Moving"
            return port.use(lambda bus: [bus[1].register(name) for name in names])

        wait_for(lambda: state() == [255, 1, 0])  # 255: it has tripped
        assert port.use(lambda bus: bus[1].true_ticks) < 2048 + 600  # the goal is 2048 + 913


@pytest.mark.skipif(find_spec("nicegui") is None, reason="needs NiceGUI")
def test_stop_on_the_page_relaxes_the_servos_of_a_control_process_that_hangs(bench):
    words = "--target", "smooth", "--viewer", "--on-crash", "hold"
    run = bench.run(*words, ros=("-p", "viewer:port:=0"))
    address = re.search(r"http://\S+", run.read_until("the robot is at http"))
    wait_for(lambda: bench.servos.torque == [1, 1])
    os.kill(child(run.process.pid, "control"), signal.SIGSTOP)
    stop = urllib.request.Request(
        f"{address[0]}/head/stop", b"", {"X-Head-Tracking": "page"}, method="POST"
    )
    with urllib.request.urlopen(stop, timeout=PATIENCE) as answer:
        assert json.load(answer)["done"] is False
    assert run.end() == 1, run.output
    assert "SIGKILL" in run.output
    assert bench.servos.torque == [0, 0]


def restarted(run, name, pid):
    """Kill a process; return the process that takes its place."""
    os.kill(pid, signal.SIGKILL)
    return wait_for(
        lambda: child(run.process.pid, name) not in (0, pid) and child(run.process.pid, name)
    )


def is_accepted(call):
    """Whether the system lets a process of this user make a call."""
    return run_python("-c", f"import os; {call}").returncode == 0


@needs_opencv
def test_vision_is_restarted_in_the_same_state(bench):
    """When it is killed during its start, too."""
    run = bench.start("head_tracking", "--sim", "--target", "ball")
    person = bench.person
    vision = restarted(run, "vision", wait_for(lambda: child(run.process.pid, "vision")))
    enabled = person.hear("visual_target/enabled", Bool, LATCHED)
    wait_for(lambda: person.state("head_tracker") == "tracking")
    assert person.call("visual_target/enable", False).success
    wait_for(lambda: enabled and not enabled[-1].data)
    control = child(run.process.pid, "control")
    is_allowed = is_accepted("os.setpriority(os.PRIO_PROCESS, 0, -10)")
    assert os.getpriority(os.PRIO_PROCESS, control) == (-10 if is_allowed else 0)
    assert os.getpriority(os.PRIO_PROCESS, vision) == (-5 if is_allowed else 0)
    policies = set()
    for thread in map(int, os.listdir(f"/proc/{control}/task")):
        with suppress(ProcessLookupError):
            policies.add(os.sched_getscheduler(thread))
    is_allowed = is_accepted("os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))")
    has_spare_core = len(os.sched_getaffinity(0)) > 1
    assert policies == {os.SCHED_RR if is_allowed and has_spare_core else os.SCHED_OTHER}
    time.sleep(1.0)  # the state is reported every 0.1 s
    enabled.clear()
    restarted(run, "vision", vision)
    wait_for(lambda: enabled and not enabled[-1].data)
    assert person.call("visual_target/enable", True).success
    wait_for(lambda: person.state("head_tracker") == "tracking")
    assert child(run.process.pid, "control") == control
    assert run.end(signal.SIGINT) == 0, run.output


@needs_opencv
def test_the_head_continues_while_the_machine_has_nothing_left_for_a_restart(bench):
    run = bench.run("--target", "ball")
    supervisor, states = run.process.pid, bench.person.hear("servo_states", JointState)
    wait_for(lambda: states)
    control, vision = (
        wait_for(lambda name=name: child(supervisor, name)) for name in ("control", "vision")
    )
    score, other = (Path(f"/proc/{pid}/oom_score") for pid in (control, vision))
    # the system kills that with the higher score first, without memory
    wait_for(lambda: int(score.read_text()) + 300 < int(other.read_text()))
    files = {int(name) for name in os.listdir(f"/proc/{supervisor}/fd")}
    free = min({*range(len(files) + 1)} - files)
    _, most = resource.prlimit(supervisor, resource.RLIMIT_NOFILE)
    resource.prlimit(supervisor, resource.RLIMIT_NOFILE, (free, most))
    os.kill(vision, signal.SIGKILL)
    run.read_until(os.strerror(errno.EMFILE))
    states.clear()
    wait_for(lambda: len(states) > 50)
    resource.prlimit(supervisor, resource.RLIMIT_NOFILE, (most, most))
    wait_for(lambda: child(supervisor, "vision"))
    assert child(supervisor, "control") == control
    assert run.end(signal.SIGINT) == 0, run.output


@needs_opencv
@pytest.mark.skipif(find_spec("nicegui") is None, reason="needs NiceGUI")
def test_a_node_that_could_not_start_can_be_requested_again_and_the_page_is_restarted(bench):
    rules = "viewer:port:=0", "viewer:host:=0.0.0.0", "visual_target:max_distance:=-1.0"
    ros = ("--ros-args", *(word for rule in rules for word in ("-p", rule)))
    run = bench.start("head_tracking", "--sim", "--viewer", *ros)
    answer = bench.person.call("node_starter/visual_target")
    assert not answer.success and "max_distance" in answer.message
    assert not bench.person.call("node_starter/visual_target").success
    for _ in range(2):
        assert bench.person.call("node_starter/point_head").success
    run.read_until("the robot is at http")
    has_camera = find_spec("cv2") is not None
    wait_for(lambda: bool(child(run.process.pid, "vision")) is has_camera)
    bench.person.get("viewer", "port")
    page = restarted(run, "page", child(run.process.pid, "page"))
    wait_for(lambda: run.output.count("the robot is at http") == 2)
    assert len(set(re.findall(r"http://\S+token=\S+", run.output))) == 1  # as open browsers know it
    run.process.kill()
    wait_for(lambda: has_ended(page))


@needs_opencv
@pytest.mark.skipif(find_spec("nicegui") is None, reason="needs NiceGUI")
def test_a_node_that_is_requested_while_it_starts_does_not_end_the_run(bench):
    words = ("--sim", "--viewer", "--ros-args", "-p", "viewer:port:=0")
    run = bench.start("head_tracking", *words)
    vision = wait_for(lambda: child(run.process.pid, "vision"))
    os.kill(vision, signal.SIGSTOP)
    threading.Timer(3.0, os.kill, (vision, signal.SIGCONT)).start()
    page = wait_for(lambda: child(run.process.pid, "page"))
    os.kill(page, signal.SIGSTOP)
    run.read_until("the page starts")
    os.kill(page, signal.SIGCONT)
    assert bench.person.call("node_starter/visual_target").success
    wait_for(lambda: bench.person.state("head_tracker") in ("acquiring", "tracking"))
    run.read_until("the robot is at http")
    wait_for(lambda: run.last_line.startswith("error"))
    assert run.end(signal.SIGINT) == 0, run.output
    assert "bus cycles" in run.output


def test_a_camera_process_that_ends_at_its_start_ends_the_run(bench):
    (bench.folder / "cv2.py").write_text("import os\nos._exit(99)")  # as a broken library does
    paths = {"PYTHONPATH": f"{bench.folder}:{PYTHONPATH}"}
    run = bench.start("head_tracking", "--sim", "--target", "face", environment=paths)
    assert run.end() == 1
    assert run.last_line.endswith(" 99")


@pytest.mark.skipif(find_spec("nicegui") is None, reason="needs NiceGUI")
def test_a_page_that_cannot_start_is_left_out(bench):
    words = ("--ros-args", "-p", "viewer:port:=0", "-p", "viewer:no_such:=1")
    run = bench.start("head_tracking", "--sim", "--viewer", *words)
    run.read_until("no_such")
    wait_for(lambda: bench.person.state("head_tracker") == "tracking")
    page = child(run.process.pid, "page")
    time.sleep(2.0)  # it would be restarted after 1 s
    assert child(run.process.pid, "page") == page != 0
    assert run.end(signal.SIGINT) == 0, run.output
    assert run.output.count("no_such") == 1
