"""The names of a head in the ROS graph, with types and QoS; parameters with meaning and range."""

from contextlib import closing

import pytest
from rig import JOINTS, Bench, assert_described
from waiting import wait_for

RELIABLE, LATCHED = ("RELIABLE", "VOLATILE"), ("RELIABLE", "TRANSIENT_LOCAL")
BUS_PUBLISHES = {
    "servo_states": ("sensor_msgs/msg/JointState", RELIABLE),
    "joint_goals": ("sensor_msgs/msg/JointState", RELIABLE),
    "joint_owners": ("std_msgs/msg/String", LATCHED),
    "stopped": ("std_msgs/msg/Bool", LATCHED),
    "joint_control": ("diagnostic_msgs/msg/DiagnosticStatus", LATCHED),
    "/diagnostics": ("diagnostic_msgs/msg/DiagnosticArray", RELIABLE),
}
CONTROLLERS = ("head_pan_controller", "head_tilt_controller")
BUS_HEARS = {
    "joint_commands": "sensor_msgs/msg/JointState",
    "joint_claims": "sensor_msgs/msg/JointState",
    **{f"{each}/{name}": "std_msgs/msg/Float64" for each in CONTROLLERS
       for name in ("command", "speed")},
}  # fmt: skip
TRIGGER, SET_BOOL = "std_srvs/srv/Trigger", "std_srvs/srv/SetBool"
ALIASED = {"stop": TRIGGER, "resume": TRIGGER, "relax": TRIGGER, "recover": TRIGGER}
ALIASED |= {"torque_enable": SET_BOOL}
OF_A_JOINT = {"stop": TRIGGER, "start": TRIGGER, "restart": TRIGGER, "recover": TRIGGER}
OF_A_JOINT |= {"torque_enable": SET_BOOL}
BUS_SERVES = {
    **ALIASED,
    **{f"servo_bus/{name}": kind for name, kind in ALIASED.items()},
    "servo_bus/write_eeprom": TRIGGER,
    **{f"{each}/{name}": kind for each in CONTROLLERS for name, kind in OF_A_JOINT.items()},
}
ROBOT_PUBLISHES = {
    "joint_states": ("sensor_msgs/msg/JointState", RELIABLE),
    "robot_description": ("std_msgs/msg/String", LATCHED),
}
HEADS = {"track": ("head_tracker", "tracking_error"), "point": ("point_head", "pointing_error")}


@pytest.fixture(scope="module", params=["track", "point"])
def running(request, tmp_path_factory):
    with closing(Bench(tmp_path_factory.mktemp("bench"))) as bench:
        ros = ("--ros-args", "-r", "__ns:=/robot")
        words = ("--sim", "--mode", request.param, "--target", "fictitious", *ros)
        bench.start("head_tracking", *words)
        bench.robot = bench.meet("/robot")
        bench.robot.wait_for_joints()
        bench.head, bench.error = HEADS[request.param]
        wait_for(lambda: bench.robot.state(bench.head) != "idle")
        yield bench


def test_topics_have_their_types_and_qos(running):
    person, head = running.robot, running.head
    published = {
        **BUS_PUBLISHES,
        **ROBOT_PUBLISHES,
        f"{head}/state": ("std_msgs/msg/String", LATCHED),
        f"{head}/enabled": ("std_msgs/msg/Bool", LATCHED),
        f"{head}/{running.error}": ("std_msgs/msg/Float64", RELIABLE),
        "target_point": ("geometry_msgs/msg/PointStamped", RELIABLE),
        "fictitious_target/enabled": ("std_msgs/msg/Bool", LATCHED),
    }
    heard = {**BUS_HEARS, "target_point": "geometry_msgs/msg/PointStamped"}

    def differences():
        found = {
            topic: {
                (i.topic_type, (i.qos_profile.reliability.name, i.qos_profile.durability.name))
                for i in publishers(person.name(topic))
            }
            for topic in published
        }
        wrong = {
            topic: found[topic] for topic, as_said in published.items() if found[topic] != {as_said}
        }
        types = {topic: {i.topic_type for i in hearers(person.name(topic))} for topic in heard}
        return wrong | {t: types[t] for t, kind in heard.items() if types[t] != {kind}}

    publishers = person.node.get_publishers_info_by_topic
    hearers = person.node.get_subscriptions_info_by_topic
    wait_for(lambda: not differences())


def test_services_have_their_types(running):
    person = running.robot
    asked = BUS_SERVES | {
        f"{running.head}/enable": SET_BOOL,
        f"{running.head}/recenter": TRIGGER,
        "fictitious_target/enable": SET_BOOL,
        "robot_state_publisher/frames": TRIGGER,
    }

    def missing():
        found = dict(person.node.get_service_names_and_types())
        return [name for name, kind in asked.items() if found.get(person.name(name)) != [kind]]

    wait_for(lambda: not missing())


def test_everything_of_the_run_is_in_its_namespace(running):
    of_ros = {"/diagnostics", "/rosout", "/parameter_events", "/tf", "/tf_static", "/joint_states"}
    names = {name for name, _ in running.robot.node.get_topic_names_and_types()}
    assert {name for name in names if not name.startswith(("/robot/", "/person"))} <= of_ros


def test_the_servo_bus_describes_its_parameters(running):
    assert_described(running.robot, "servo_bus")


def test_the_parameters_of_the_tutorials_exist(running):
    person = running.robot
    assert person.get("servo_bus", "dynamixels") == ["head_pan", "head_tilt"]
    assert person.get("servo_bus", "head_pan_controller.motor.id") == 1
    assert person.get("servo_bus", "head_pan_controller.joint_name") == JOINTS[0]
    names = {"head_tracker": ("k_pan", "k_tilt"), "point_head": ()}
    for name in ("pointing_frame", "camera_link", *names[running.head]):
        assert person.get(running.head, name) is not None
