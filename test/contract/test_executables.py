"""Every executable: what it needs, and the exit code of a mistake."""

import signal
from importlib.util import find_spec

import pytest
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from program_names import NODES
from rig import LATCHED, assert_described, run_python
from std_srvs.srv import Trigger


def run_without(package, words, **environment):
    """Run a program as on a computer where a package is not installed."""
    name, *arguments = words.split()
    missing = f"import sys; sys.argv[0] = {name!r}; sys.modules[{package!r}] = None; "
    program = f"from head_tracking.programs import {name} as main; sys.exit(main())"
    return run_python("-c", missing + program, *arguments, **environment)


@pytest.mark.parametrize(
    "words", ["head_tracking --sim", "servo_bus", "recorder", "look 1,0,1@base_link"]
)
def test_a_program_that_needs_ros_reports_that_ros_is_missing(words):
    done = run_without("rclpy", words)
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert "ROS 2" in done.stderr


@pytest.mark.parametrize(
    ("words", "package", "named"),
    [
        ("detection_target --ros-args -p source:=detections_2d", "vision_msgs", "vision_msgs"),
        ("detection_target --ros-args -p source:=faces", "hri_msgs", "hri_msgs"),
        ("visual_target", "cv2", "OpenCV"),
        ("calibrate camera --sim --yes", "cv2", "OpenCV"),
    ],
)
def test_a_program_reports_the_package_that_is_missing(bench, words, package, named):
    done = run_without(package, words, ROS_DOMAIN_ID=bench.domain)
    assert done.returncode == 1
    assert named in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("words", "code", "fact"),
    [
        ("head_tracking --simm", 2, "--simm"),
        ("head_tracking --sim --ros-args -p arm:update_rate:=40.0", 1, "arm"),
        (
            "head_tracking --sim --ros-args -r __ns:=/left -p servo_bus:updat_rate:=40.0",
            *(1, "servo_bus"),
        ),
        (
            "head_tracking --sim --ros-args -p command_interface:=joint_trajectory",
            *(1, "command_interface"),
        ),
        pytest.param(
            "head_tracking --sim --target face --ros-args -p visual_target:max_distance:=-1.0",
            *(1, "max_distance"),
            marks=pytest.mark.skipif(find_spec("cv2") is None, reason="needs OpenCV"),
        ),
        ("servo_bus --ros-args --sim", 1, "--ros-args"),
        ("servo_bus --ros-args -p port_name:=/dev/ttyNOT0", 1, "/dev/ttyNOT0"),
        ("servo_bus --ros-args -p update_rate:=0.0", 1, "update_rate"),
        ("servo_bus --ros-args -p dynamixels:=[head_pan,head_roll]", 1, "head_roll"),
        ("servo_bus --ros-args -p dynamixels:=[]", 1, "dynamixels is empty"),
        ("robot_state_publisher --ros-args -p world_transform:=[0.0,1.0]", 1, "world_transform"),
        (
            "target_mux --ros-args -p sources:=[face] -p face.topic:=/target_point",
            1,
            "target_point",
        ),
        ("target_mux --ros-args -p sources:=[]", 1, "sources is empty"),
        ("transforms tree --wait 0.3", 1, ""),
        ("look 1,1,0.5@base_link --wait 0.3", 1, ""),
        ("look @base_link --ros-args -p head_pan:=pan", 3, "head_pan"),
        ("simulated_bus --baud 2000000", 1, "2000000"),
    ],
)
def test_usage_errors_have_an_exit_code_and_name_the_fact(bench, words, code, fact):
    program = bench.start(*words.split())
    assert program.end() == code, program.output
    assert program.output
    assert fact in program.output


def test_a_run_that_cannot_start_reports_the_reason_on_standard_error(bench):
    words = ("-m", "head_tracking", "--port", "/dev/ttyNOT0")
    done = run_python(*words, ROS_DOMAIN_ID=bench.domain)
    assert (done.returncode, done.stdout) == (1, "")
    assert "/dev/ttyNOT0" in done.stderr


def test_every_node_runs_alone_and_ends_at_ctrl_c(bench):
    done = Trigger.Response(success=True)  # of a mobile base
    bench.person.node.create_service(Trigger, "relax", lambda _, __: done)
    for pairs in ([], [KeyValue(key="epoch", value="1")]):  # malformed; of no node
        control = bench.person.node.create_publisher(DiagnosticStatus, "joint_control", LATCHED)
        control.publish(DiagnosticStatus(values=pairs))
    relax = bench.start("relax")  # it waits 10 s for a servo bus
    names = NODES - {"servo_bus", "viewer", "recorder"}
    if find_spec("vision_msgs") is None:  # it ends with an error
        names -= {"detection_target"}
    nodes = {name: bench.start(name) for name in names}
    for name in names:
        bench.person.wait_for_node(name)
        assert_described(bench.person, name)
    for node in nodes.values():
        assert node.end(signal.SIGINT) == 0, node.output
    assert relax.end() == 1, relax.output
    assert relax.output
