"""What the answer to a request says is so when it comes; a request that fails changes nothing."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from dynamixel_fakes import PAN, TORQUE, FakeRig, submit
from simulated_device import Bench, Rig

from head_tracking.control import ControlLoop
from head_tracking.control.dynamixel_backend import DynamixelBackend
from head_tracking.dynamixel import Goal, ServoError, StoppedError, Torque, TorqueError
from head_tracking.dynamixel.servo import run
from head_tracking.simulation import SimulatedServo


@pytest.fixture
def rig() -> Rig:
    """Return a joint with torque on."""
    rig = Rig(SimulatedServo(1, "XM430-W350", boot_time=0.1))
    rig.go(0.3)
    return rig


# Starting


def test_nobody_is_told_that_a_joint_was_started_whose_servo_does_not_answer(rig: Rig) -> None:
    run(rig.bus.stopping(None))
    rig.servos[0].power_off()
    starting = [submit(rig.bus, rig.bus.starting(None)) for _ in range(2)]
    rig.step(100)
    for each in starting:
        assert isinstance(each.exception(0.0), ServoError)


def test_a_joint_is_started_when_its_servo_has_confirmed_that_it_is_relaxed() -> None:
    rig = FakeRig(PAN)
    run(rig.bus.stopping(None))
    rig.pan["Torque Enable"] = 1
    rig.pan.ignored.add(TORQUE)
    starting = submit(rig.bus, rig.bus.starting(None))
    for _ in range(2000):
        rig.bus.cycle.fill(rig.bench.now() + 1_000_000_000)
        rig.bench.pass_time(0.002)
        rig.bus.step()
    assert isinstance(starting.exception(0.0), ServoError)


# Torque on


def test_torque_is_called_on_when_it_is_on_though_the_bus_has_not_switched_it_off(
    rig: Rig,
) -> None:
    rig.servos[0].set_register("Torque Enable", 0)  # by another program
    on = submit(rig.bus, rig.bus.switching_torque(None, True))
    while not on.done():
        rig.step()
    assert on.exception() is None
    assert rig.torque == [1]


def test_torque_of_a_servo_that_does_not_answer_is_not_called_on(rig: Rig) -> None:
    rig.servos[0].power_off()
    rig.step(2)
    on = submit(rig.bus, rig.bus.switching_torque(None, True))
    rig.step(20)
    assert isinstance(on.exception(0.0), TorqueError)


def test_a_joint_that_is_relaxed_while_its_torque_is_checked_stays_relaxed(rig: Rig) -> None:
    for steps in range(8):
        run(rig.bus.switching_torque(None, True), rig.bench.pass_time)
        rig.servos[0].set_register("Torque Enable", 0)
        submit(rig.bus, rig.bus.switching_torque(None, True))
        for _ in range(steps):
            rig.bus.cycle.fill(rig.bench.now() + 1_000_000_000)
        submit(rig.bus, rig.bus.switching_torque(None, False))
        rig.step(20)
        assert (rig.torque, rig.bus.joint("j1").torque) == ([0], Torque.OFF_ON_REQUEST), steps


def test_a_joint_accepts_a_command_as_soon_as_its_torque_is_on(rig: Rig) -> None:
    """Its servo has just returned."""
    rig.servos[0].power_off()
    rig.step(20)
    rig.servos[0].power_on()
    for number in range(500):
        rig.bench.pass_time(0.001)
        on = submit(rig.bus, rig.bus.switching_torque(None, True))
        while not on.done() and rig.bus.cycle.fill(rig.bench.now() + 1_000_000_000):
            pass
        if on.done() and on.exception() is None:
            break
        if number % 20 == 0:
            rig.bus.step()
    rig.bus.command({"j1": Goal(0.1)})
    rig.step(60)
    assert rig.reading.states["j1"].position == pytest.approx(0.1, abs=0.02)


# A request that fails


def stopped(rig: Rig) -> None:
    on = submit(rig.bus, rig.bus.switching_torque(None, True))
    rig.bus.cycle.fill(rig.bench.now() + 1_000_000_000)
    rig.bus.relax_at_once(1.0)
    assert isinstance(on.exception(0.0), StoppedError)


def cancelled(rig: Rig) -> None:
    assert submit(rig.bus, rig.bus.switching_torque(None, True)).cancel()


def silent(rig: Rig) -> None:
    rig.servos[0].power_off()
    rig.step(20)
    on = submit(rig.bus, rig.bus.switching_torque(None, True))
    rig.step(20)
    assert isinstance(on.exception(0.0), TorqueError)
    rig.servos[0].power_on()


@pytest.mark.parametrize("fails", [stopped, cancelled, silent])
def test_a_joint_that_was_relaxed_on_request_stays_so_if_its_torque_does_not_come_on(
    rig: Rig, fails: Callable[[Rig], None]
) -> None:
    run(rig.bus.switching_torque(None, False))
    fails(rig)
    rig.step(20)
    assert rig.bus.joint("j1").torque is Torque.OFF_ON_REQUEST
    run(rig.bus.switching_torque(None, True))
    assert rig.go(0.1).states["j1"].position == pytest.approx(0.1, abs=0.02)


def test_resume_does_not_hold_a_joint_that_is_relaxed_at_the_same_time() -> None:
    """The bus executes both requests in one cycle."""
    bench, loop = Bench([SimulatedServo(1)]), ControlLoop(None)
    bus = bench.servo_bus([PAN], loop.owners.epoch)
    backend = DynamixelBackend([bus], loop, 50.0)
    backend.connect()
    run(bus.switching_torque(None, True))
    loop.attach(backend)
    assert not any(loop.stop().values())
    backend.switch_torque(None, False)
    backend.resume()
    for _ in range(20):
        bus.requests.begin_next()
        bench.pass_time(0.02)
        bus.step()
    assert bench.torque == [0]
    assert bus.joint(PAN.joint_name).torque is Torque.OFF_ON_REQUEST
