"""A run: its options, parameters and end, judged by its servos."""

import math
import os
import re
import signal
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rig import DEGREE, JOINTS, PYTHONPATH, SOURCE, child
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from terminal import Terminal
from waiting import wait_for

from head_tracking.simulation import SimulatedPort, SimulatedServo

X_SERVOS = """
servo_bus:
  ros__parameters:
    head_pan_controller: {motor: {id: 6}}
    head_tilt_controller: {motor: {id: 7}}
"""


def params(bench, text):
    file = bench.folder / "params.yaml"
    file.write_text(text)
    return str(file)


def moves(bench):
    wait_for(lambda: bench.servos.torque == [1, 1])


def catches_signals(run):
    status = Path(f"/proc/{run.process.pid}/status").read_text()
    caught = re.search(r"SigCgt:\s*(\w+)", status)[1]
    return int(caught, 16) >> (signal.SIGTERM - 1) & 1


# options


def test_a_run_with_a_duration_ends_with_a_summary(bench, monkeypatch):
    program = bench.folder / "bin" / "start.py"
    program.parent.mkdir()
    program.write_text("from head_tracking.programs import head_tracking as p\nexit(p())")
    if sys.version_info >= (3, 11):  # before, each Python prefers modules of the working folder
        (bench.folder / "queue.py").write_text("raise RuntimeError('a file of the user')")
    monkeypatch.chdir(bench.folder)
    words = ("--sim", "--duration", "2", "--params", params(bench, X_SERVOS))
    run = bench.start(str(program), *words)
    assert run.end() == 0, run.output
    assert "6, 7" in run.output
    assert re.search(r"; \d+ bus cycles, \d+ faults", run.last_line)


def test_a_head_that_lacks_a_joint_waits_and_names_it(bench):
    text = "servo_bus: {ros__parameters: {head_pan_controller: {joint_name: neck}}}\n"
    run = bench.start("head_tracking", "--sim", "--params", params(bench, text))
    wait_for(lambda: JOINTS[0] in bench.person.latched("head_tracker/state"))
    assert bench.person.state("head_tracker") == "idle"
    assert run.end(signal.SIGINT) == 0, run.output


def test_a_servo_bus_has_joints_at_two_ports(bench):
    person, pan = bench.person, bench.servos
    with SimulatedPort([SimulatedServo(2)]) as tilt:
        bench.run_bus("-p", f"head_tilt_controller.port_name:={tilt.port_name}")
        person.wait_for_node("servo_bus")
        diagnostics = person.hear("/diagnostics", DiagnosticArray)

        def commanded(position):
            onward = JointState(name=list(JOINTS), position=[position, -position])
            person.publish("joint_commands", onward)
            return pan.true[0] > 0.15 and tilt.use(lambda bus: bus[2].true_ticks) < 512 - 35

        person.complaint("servo_bus", "nan", of=lambda: commanded(math.nan))
        assert set(person.owners.values()) == {""}  # what is refused claims nothing
        wait_for(lambda: commanded(0.2))
        assert pan.true[1] == 0.0
        names = {f"servo_bus: {pan.name}", f"servo_bus: {tilt.port_name}"}
        wait_for(lambda: names <= {s.name for message in diagnostics for s in message.status})


def test_a_simulated_head_may_have_two_ports(bench):
    text = "servo_bus: {ros__parameters: {head_tilt_controller: {port_name: /dev/ttyOTHER}}}\n"
    run = bench.start("head_tracking", "--sim", "--params", params(bench, text))
    run.read_until("° tilt")  # in the status line
    assert run.end(signal.SIGINT) == 0, run.output


def own_model(bench, kinectbot):
    """Return the options of a run with a file of the user."""
    file = bench.folder / "mine.urdf"
    file.write_text(kinectbot.urdf)
    return "--robot", str(file), "--target", "none"


def root_frame(person):
    return person.call("robot_state_publisher/frames").message.split()[0]


def test_ros_arguments_remap_and_set_parameters(bench, kinectbot):
    values = ("bus:update_rate:=40.0", "bus:short_names:=false")
    values = (*values, "robot_state_publisher:world_frame:=map")
    ros = [word for value in values for word in ("-p", value)]
    rules = ("-r", "servo_states:=measured", "-r", "servo_bus:__node:=bus")
    run = bench.run(*own_model(bench, kinectbot), ros=(*ros, *rules))
    person = bench.person
    done = Trigger.Response(success=True)  # of a mobile base
    person.node.create_service(Trigger, "relax", lambda _, __: done)
    assert root_frame(person) == "map"
    states = person.hear("measured", JointState)
    wait_for(lambda: len(states) > 50)
    assert person.get("bus", "update_rate") == 40.0
    person.until_done("bus/stop")
    assert "/stop" not in dict(person.node.get_service_names_and_types())
    relax = bench.start("relax")
    assert relax.end() == 0, relax.output
    assert JOINTS[0] in relax.output
    assert run.end(signal.SIGINT) == 0, run.output


def test_a_head_runs_in_a_namespace_and_with_prefixed_frames(bench, kinectbot):
    """The file of the user has a world frame only where one is named."""
    prefix = (
        "robot_state_publisher:frame_prefix:=left_",
        "head_tracker:camera_link:=left_camera_link",
    )
    rules = [word for rule in ("servo_bus:update_rate:=40.0", *prefix) for word in ("-p", rule)]
    model = own_model(bench, kinectbot)
    bench.start("head_tracking", "--sim", *model, "--ros-args", "-r", "__ns:=/left", *rules)
    person = bench.meet("/left")
    person.wait_for_joints()
    assert person.get("servo_bus", "update_rate") == 40.0
    assert root_frame(person) == "left_base_link"
    assert JOINTS[0] in person.latched("robot_description", String)
    person.keep_looking(2.0, 1.0, 1.0, lambda: person.pan > 0.3, "left_base_link")


def test_a_run_continues_with_a_closed_pipe_and_a_full_disk(bench):
    words = ("head_tracking", "--sim", "--duration", "1", "--ros-args", "-r")
    (bench.folder / "sitecustomize.py").write_text("import tempfile; tempfile.tempdir = '/proc/0'")
    path = {"PYTHONPATH": f"{bench.folder}:{PYTHONPATH}"}
    reader, writer = os.pipe()
    with open("/dev/full", "w") as full:
        outputs = {"__ns:=/left": writer, "__ns:=/right": full}
        runs = [
            bench.start(*words, rule, stdout=output, environment=path)
            for rule, output in outputs.items()
        ]
    os.close(writer)
    os.read(reader, 1)
    os.close(reader)
    assert [run.end() for run in runs] == [0, 0]


# the end


@pytest.mark.parametrize(
    ("number", "environment", "in_all"),
    [
        (signal.SIGTERM, {"HOME": None, "ROS_LOG_DIR": None}, False),
        (signal.SIGHUP, {"ROS_LOG_DIR": "/proc/none", "PYTHONIOENCODING": "ascii"}, False),
        (signal.SIGINT, {}, True),
    ],
    ids=["terminated", "hung up", "Ctrl-C in all processes"],
)
def test_a_signal_stops_and_relaxes_the_head_in_any_environment(bench, number, environment, in_all):
    """Without a log file, and where only ASCII can be printed."""
    run = bench.run("--target", "smooth", environment=environment, own_group=in_all)
    moves(bench)
    while in_all and run.process.poll() is None:  # again and again
        os.killpg(run.process.pid, number)
        time.sleep(0.02)
    assert run.end(None if in_all else number) == 0, run.output
    assert "killed" not in run.output
    assert bench.servos.torque == [0, 0]
    bench.servos.at_rest()


@pytest.mark.parametrize(("delay", "kill"), [(0.0, os.killpg), (1.0, os.killpg), (0.0, os.kill)])
def test_a_run_is_ended_during_its_start_without_a_word(bench, delay, kill):
    words = ("--target", "face", "--viewer")
    run = bench.run(*words, ros=("-p", "viewer:port:=0"), own_group=True)
    wait_for(lambda: catches_signals(run))
    time.sleep(delay)
    kill(run.process.pid, signal.SIGINT)
    assert run.end() == 0, run.output
    for word in ("Fatal", "killed", "restarted"):
        assert word not in run.output
    assert bench.servos.torque == [0, 0]


def test_after_a_killed_run_nothing_moves_and_the_next_run_works(bench):
    run = bench.run("--target", "smooth")
    moves(bench)
    run.kill()
    before = bench.servos.at_rest()
    time.sleep(0.3)
    assert bench.servos.at_rest() == before
    following = bench.run("--mode", "point")
    bench.person.wait_for_joints()
    assert bench.servos.at_rest() == pytest.approx(before, abs=0.02)
    assert following.end(signal.SIGINT) == 0, following.output
    assert bench.servos.torque == [0, 0]


@pytest.mark.parametrize("name", ["head_tracking", "servo_bus"])
def test_a_run_without_its_adapter_ends_with_1_and_names_the_joints(bench, name):
    program = bench.run_bus() if name == "servo_bus" else bench.run()
    states = bench.person.hear("servo_states", JointState)
    wait_for(lambda: states)
    bench.servos.port.close()
    bench.person.complaint("servo_bus")
    assert program.end(signal.SIGINT) == 1, program.output
    assert all(joint in program.output for joint in JOINTS)


def test_a_port_name_that_does_not_return_ends_the_run(bench):
    run = bench.start("head_tracking", "--port", os.path.realpath(bench.servos.name))
    bench.person.wait_for_joints()
    bench.servos.port.close()
    assert run.end() == 1
    assert "servo_bus" in run.last_line


def test_a_port_in_use_and_a_servo_that_is_missing_are_errors(bench):
    first = bench.run_bus()
    states = bench.person.hear("servo_states", JointState)
    wait_for(lambda: states)
    second = bench.start("servo_bus", "--ros-args", "-p", f"port_name:={bench.servos.name}")
    assert second.end() == 1
    assert bench.servos.name in second.output
    assert first.end(signal.SIGINT) == 0, first.output
    third = bench.run("--params", params(bench, X_SERVOS))
    assert third.end() == 1
    assert bench.servos.name in third.last_line


# a terminal


@pytest.fixture
def terminal(bench, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", bench.domain)
    monkeypatch.chdir(SOURCE)
    with closing(Terminal()) as terminal:
        yield terminal


def test_keys_stop_and_resume_a_run_in_the_foreground(bench, terminal):

    def press(key, torque):
        """Keys are read soon after the program has the terminal again."""
        wait_for(lambda: terminal.type(key) or bench.servos.torque == torque)

    terminal.start(f"-m head_tracking --port {bench.servos.name} --target smooth &")
    moves(bench)
    assert terminal.is_as_before()  # its keys are the shell's
    terminal.type("echo sss\n")
    terminal.waits_for("\r\nsss\r")
    assert bench.servos.torque == [1, 1]
    terminal.type("fg\n")
    press("\x1b[A\x1bOS ", [0, 0])
    wait_for(lambda: bench.person.stopped)
    terminal.type("x\x1a")
    terminal.waits_for("Stopped")
    assert terminal.is_as_before()
    terminal.type("fg\n")
    press("r", [1, 1])
    wait_for(lambda: not bench.person.stopped)
    terminal.type("\x03")
    terminal.waits_for(r"bus cycles.*\$ ")
    assert terminal.is_as_before()
    assert bench.servos.torque == [0, 0]


def test_the_stop_key_works_while_a_node_still_starts(bench, terminal):
    terminal.start(f"-m head_tracking --port {bench.servos.name} --target face &")
    supervisor = int(terminal.waits_for(r"\[1\] \d+").split()[-1])
    terminal.type("fg\n")
    wait_for(lambda: child(supervisor, "vision"))
    os.kill(child(supervisor, "vision"), signal.SIGSTOP)
    wait_for(lambda: bench.person.look_at(1.0, 0.3, 0.8) or any(bench.servos.torque))
    terminal.type(" ")
    wait_for(lambda: bench.person.stopped, 5.0)
    assert bench.servos.torque == [0, 0]


def test_stop_relaxes_the_servos_of_a_control_process_that_hangs(bench, terminal):
    terminal.start(f"-m head_tracking --port {bench.servos.name} --target smooth --on-crash hold &")
    terminal.type("stty cols 50\n")  # what is left out of a narrow line is not the key of STOP
    supervisor = int(terminal.waits_for(r"\[1\] \d+").split()[-1])
    terminal.type("fg\n")
    moves(bench)
    terminal.waits_for("space: STOP")
    os.kill(child(supervisor, "control"), signal.SIGSTOP)
    wait_for(lambda: terminal.type(" ") or bench.servos.torque == [0, 0])
    assert "SIGKILL" in terminal.waits_for(r"\$ ")


# other heads


def test_the_first_of_simulated_runs_continues_until_a_real_head_comes_and_none_turns_that(bench):
    first = bench.start("head_tracking", "--sim")
    wait_for(lambda: bench.person.state("head_tracker") == "tracking")
    second = bench.start("head_tracking", "--sim")
    second.read_until("servo_bus")
    wait_for(lambda: bench.person.state("head_tracker") == "tracking")
    beside = bench.start("head_tracking", "--sim", "--duration", "1", "--allow-others")
    assert beside.end() == 0, beside.output
    real = bench.run_bus()
    assert first.end() == 1, first.output
    later = bench.start("head_tracking", "--sim")
    later.read_until("servo_bus")  # it refuses, or ends when it discovers the head
    time.sleep(2.0)
    assert bench.servos.torque == [0, 0]
    assert bench.servos.true == (0.0, 0.0)
    assert real.end(signal.SIGINT) == 0, real.output


def test_with_allow_others_the_last_command_wins(bench):
    bench.run("--target", "none", "--allow-others")
    bench.person.wait_for_joints()
    wait_for(lambda: set(bench.person.owners.values()) == {"/head_tracker"})
    bench.person.command("head_pan_controller", 0.3)
    wait_for(lambda: abs(bench.person.pan - 0.3) < DEGREE)
    bench.person.keep_looking(2.0, 0.0, 0.5, lambda: abs(bench.person.pan) < DEGREE)
