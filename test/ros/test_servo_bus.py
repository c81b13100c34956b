"""The servo bus under several clients at once, its limits, and several buses in one node."""

import math
import threading
import time

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger
from waiting import PATIENCE, wait_for

from head_tracking.control import ControlLoop
from head_tracking.dynamixel import servo_model
from head_tracking.ros.bus import bus_services
from head_tracking.ros.bus.servo_bus import ServoBusNode
from head_tracking.simulation import SimulatedPort, SimulatedServo

PAN, TILT = "head_pan_joint", "head_tilt_joint"
MAXIMUM = "head_pan_controller.motor.max"


def test_relaxing_waits_for_no_other_service_and_for_no_other_client(threads, monkeypatch):
    """Somebody waits for a servo that restarts, and loses its power while it does."""
    monkeypatch.setattr(bus_services, "_RESTART", 60.0)
    xm = servo_model("XM430-W350")
    servos = [SimulatedServo(i, xm, boot_time=3.0) for i in (1, 2)]
    with SimulatedPort(servos) as simulated:
        motor = {"model": "XM430-W350", "init": 2048, "min": 1024, "max": 3072}
        overrides = [
            Parameter(f"{name}_controller.motor.{key}", value=value)
            for name in ("head_pan", "head_tilt")
            for key, value in motor.items()
        ]

        overrides.append(Parameter("port_name", value=simulated.port_name))
        node = ServoBusNode(namespace="x", parameter_overrides=overrides)
        person = Node("person")
        for each in (node, person):
            threads.start(each)

        def torque(servo_id):
            return simulated.use(lambda bus: bus[servo_id].register("Torque Enable"))

        recover = person.create_client(Trigger, "x/recover")
        relaxers = [person.create_client(Trigger, "x/relax") for _ in range(3)]
        enable = person.create_client(SetBool, "x/torque_enable")
        wait_for(lambda: all(c.service_is_ready() for c in (recover, enable, *relaxers)))

        def is_enabled():  # a servo may answer late
            on = enable.call_async(SetBool.Request(data=True))
            wait_for(on.done)
            return on.result().success

        wait_for(is_enabled)
        assert torque(2) == 1
        simulated.use(lambda bus: bus[1].overload())
        wait_for(lambda: node.backend.joint(PAN).faulted)
        recovering = recover.call_async(Trigger.Request())
        wait_for(lambda: node.backend.joint(PAN).lost)  # it restarts
        simulated.use(lambda bus: bus[1].power_off())
        relaxing = [client.call_async(Trigger.Request()) for client in relaxers]
        wait_for(lambda: torque(2) == 0)
        assert not recovering.done()
        wait_for(lambda: all(future.done() for future in relaxing))
        assert not recovering.done()
        simulated.use(lambda bus: bus[1].power_on())
        wait_for(recovering.done)
        assert recovering.result().success, recovering.result().message
        node.destroy_node()


def test_two_buses_in_one_node(threads):
    ports = [SimulatedPort([SimulatedServo(i)]) for i in (1, 2)]
    for port in ports:
        port.open()

    names = ("port_name", "head_tilt_controller.port_name")
    overrides = [Parameter(n, value=p.port_name) for n, p in zip(names, ports, strict=True)]
    loop = ControlLoop(None)
    node = ServoBusNode(loop=loop, namespace="both", parameter_overrides=overrides)
    try:
        wait_for(lambda: set(node.status().states) == {PAN, TILT})
        assert node.status().port_name.count("/dev/pts/") == 2
        node._on_joint_commands(JointState(name=[PAN, TILT], position=[math.nan, math.inf]))
        assert loop.owners.of([PAN, TILT]) == {PAN: "", TILT: ""}  # what is refused claims nothing
        onward = JointState(name=[PAN, TILT], position=[0.2, -0.2])

        def turned():
            node._on_joint_commands(onward)
            pan, tilt = (p.use(lambda b, i=i: b[i].true_ticks) for i, p in enumerate(ports, 1))
            return pan > 512 + 35 and tilt < 512 - 35

        wait_for(turned)
    finally:
        node.destroy_node()
        for port in ports:
            port.close()


@pytest.fixture(scope="module")
def running(make_module_robot):
    return make_module_robot("--mode", "point")


@pytest.fixture
def robot(running):
    """Relaxed, and not stopped."""
    running.until_done("resume")
    running.until_done("relax")
    return running


def register(robot, servo_id, name):
    return robot.simulated.use(lambda bus: bus[servo_id].register(name))


def bus_thread(robot):
    return robot.composition.nodes["servo_bus"].backend.threads[0]


def test_a_request_that_timed_out_is_not_executed_later(robot, monkeypatch):
    monkeypatch.setattr(bus_services, "_TIMEOUT", 0.2)
    going_on = threading.Event()
    bus_thread(robot).bus.requests.add(lambda: going_on.wait(PATIENCE))
    answer = robot.call("torque_enable", True)
    going_on.set()
    assert not answer.success
    done = bus_thread(robot).bus.requests.add(lambda: None)
    wait_for(done.done)
    for _ in range(10):
        assert register(robot, 1, "Torque Enable") == 0
        wait_for(bus_thread(robot).bus.requests.add(lambda: None).done)


def test_the_supervisor_relaxes_servos_by_the_stable_name_of_their_adapter(robot, monkeypatch):
    """After a USB reset two adapters may have exchanged their other names."""
    node = robot.composition.nodes["servo_bus"]
    ((before, _, models),) = node.servos_by_port()
    monkeypatch.setattr(bus_thread(robot).bus.port, "stable_name", "/dev/serial/by-id/x")
    ((name, _, same),) = node.servos_by_port()
    assert (before, name) == ("simulated port", "/dev/serial/by-id/x")
    assert models == same and set(models) == {1, 2}


def test_a_stop_does_not_interrupt_the_writing_of_a_servos_memory(robot):
    """It would leave the lock of a Feetech servo's memory off."""
    robot.simulated.use(lambda bus: bus[1].set_register("CCW Angle Limit", 1000))
    client = robot.node.create_client(Trigger, "servo_bus/write_eeprom")
    wait_for(client.service_is_ready)
    writing = client.call_async(Trigger.Request())
    wait_for(lambda: register(robot, 1, "Return Delay Time") == 0)
    assert not any(robot.composition.loop.stop().values())
    wait_for(writing.done)
    assert register(robot, 1, "CCW Angle Limit") == 1023


def test_a_limit_that_the_servo_does_not_allow_is_refused(robot):
    def narrow(bus):
        bus[1].set_register("CW Angle Limit", 500)
        bus[1].set_register("CCW Angle Limit", 600)

    robot.simulated.use(narrow)
    robot.until_done("head_pan_controller/restart")
    refused = robot.set("servo_bus", MAXIMUM, 450 + 70)
    assert refused.successful, refused.reason  # init, 512, is inside
    joint = robot.composition.nodes["servo_bus"].backend.joint(PAN)
    assert joint.limits[1] == pytest.approx(8 * 0.00511327, abs=1e-3)
    robot.simulated.use(lambda bus: bus[1].set_register("CW Angle Limit", 530))
    assert robot.set("servo_bus", MAXIMUM, 1000).successful
    assert joint.limits[1] > 0.4
    robot.until_done("head_pan_controller/restart")
    refused = robot.set("servo_bus", MAXIMUM, 520)
    assert not refused.successful and refused.reason
    assert joint.limits[1] > 0.4


def test_a_limit_is_set_when_the_bus_applies_it(robot):
    joint = robot.composition.nodes["servo_bus"].backend.joint(TILT)
    before = joint.limits
    for limit in (600, 700):
        bus_thread(robot).bus.requests.add(lambda: time.sleep(0.3))
        assert robot.set("servo_bus", "head_tilt_controller.motor.max", limit).successful
        assert joint.limits != before
        before = joint.limits


def test_a_joint_that_was_relaxed_before_it_is_restarted_says_so(robot):
    assert "torque_enable" in robot.until_done("head_pan_controller/restart").message
    robot.until_done("torque_enable", True)
    assert "first command" in robot.until_done("head_pan_controller/restart").message
