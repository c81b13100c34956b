"""The servo bus under several clients at once, and its limits."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter
from rig import JOINTS, Talker
from waiting import PATIENCE, wait_for

from head_tracking.dynamixel import servo_model
from head_tracking.ros.bus import bus_services
from head_tracking.ros.bus.servo_bus import ServoBusNode
from head_tracking.simulation import SimulatedPort, SimulatedServo

PAN, TILT = JOINTS
MAXIMUM = "head_pan_controller.motor.max"


def test_relaxing_waits_for_no_other_service_and_for_no_other_client(threads, monkeypatch):
    """Somebody waits for a servo that restarts, and loses its power while it does."""
    monkeypatch.setattr(bus_services, "RESTART_TIME", 60.0)
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
        bus = ServoBusNode(namespace="x", parameter_overrides=overrides)
        person, *others = (Talker(Node(f"person_{number}"), "/x") for number in range(4))
        for node in (bus, person.node, *(other.node for other in others)):
            threads.start(node)

        def torque(servo_id):
            return simulated.use(lambda bus: bus[servo_id].register("Torque Enable"))

        person.until_done("torque_enable", True)
        assert torque(2) == 1
        simulated.use(lambda bus: bus[1].overload())
        wait_for(lambda: bus.backend.joint(PAN).faulted)
        with ThreadPoolExecutor() as pool:
            recovering = pool.submit(person.call, "recover")
            wait_for(lambda: bus.backend.joint(PAN).lost)  # it restarts
            simulated.use(lambda bus: bus[1].power_off())
            relaxing = [pool.submit(other.call, "relax") for other in others]
            wait_for(lambda: torque(2) == 0)
            assert not recovering.done()
            wait_for(lambda: all(future.done() for future in relaxing))
            assert not recovering.done()
            simulated.use(lambda bus: bus[1].power_on())
            assert recovering.result(PATIENCE).success


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
    with ThreadPoolExecutor() as pool:
        pool.submit(robot.call, "servo_bus/write_eeprom")
        wait_for(lambda: register(robot, 1, "Return Delay Time") == 0)
        assert not any(robot.composition.loop.stop().values())
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
