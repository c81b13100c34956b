"""The servo bus under several clients at once, and its limits."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from rig import JOINTS
from waiting import PATIENCE, wait_for

from head_tracking.ros.bus import bus_services

PAN, TILT = JOINTS


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


def test_a_limit_is_set_when_the_bus_applies_it(robot):
    joint = robot.composition.nodes["servo_bus"].backend.joint(TILT)
    before = joint.limits
    for limit in (600, 700):
        bus_thread(robot).bus.requests.add(lambda: time.sleep(0.3))
        assert robot.set("servo_bus", "head_tilt_controller.motor.max", limit).successful
        assert joint.limits != before
        before = joint.limits
