"""Requests, goals, STOP and resume in any order: nothing made before a STOP acts after it."""

from concurrent.futures import Future
from random import Random

import pytest
from dynamixel_fakes import PAN, TILT, FakeRig, submit
from simulated_device import Bench, Rig

from head_tracking.control import ControlLoop
from head_tracking.control.dynamixel_backend import DynamixelBackend
from head_tracking.dynamixel import (
    DynamixelError,
    EepromSettings,
    Epoch,
    Goal,
    GoalError,
    ServoError,
    StoppedError,
    Torque,
    TorqueError,
)
from head_tracking.dynamixel.servo import run
from head_tracking.simulation import SimulatedServo

INTERLEAVINGS = 10_000
JOINT = PAN.joint_name


class StopAtRead(Epoch):
    """An epoch that another thread advances, for STOP, just before it is read for the n-th time."""

    def __init__(self) -> None:
        self.left = -1
        self._now = 0
        super().__init__()

    @property
    def value(self) -> int:
        self.left -= 1
        self._now += self.left == 0
        return self._now

    @value.setter
    def value(self, value: int) -> None:
        self._now = value


@pytest.mark.parametrize("by_goal", [True, False])
def test_torque_stays_off_whenever_a_stop_overtakes_a_cycle(by_goal):
    read, stops = 0, 1
    while stops:
        read += 1
        bench, epoch = Bench([SimulatedServo(1)]), StopAtRead()
        bus = bench.servo_bus([PAN, TILT], epoch)
        bus.connect(allow_missing=True)  # while a servo is asked for, no other steps are taken
        if by_goal:
            bus.command({JOINT: Goal(0.1)})
        else:
            bus.requests.add(lambda bus=bus: bus.switching_torque(None, True))
        epoch.left, stops, cycles = read, 0, 10  # torque comes on in the fourth
        while cycles:
            cycles -= 1
            bus.requests.begin_next()
            bus.step()
            if epoch.left <= 0 and not stops:  # now STOP gets the port
                stops, cycles = epoch.value, 10
                assert bus.relax_at_once(1.0, stops)[JOINT] == ""
            assert not (stops and bench.bus[1].register("Torque Enable")), read
    assert read > 10


class Interleavings:
    """One bus, and requests that are made now and delivered later."""

    def __init__(self, seed: int) -> None:
        self.random = Random(seed)
        rig = FakeRig(PAN)
        self.servo, self.log, self.bus = rig.pan, rig.log, rig.bus
        self.epoch = self.bus.requests.epoch
        self.made: list[tuple[int | None, int]] = []  # goal in ticks or None: torque on; its epoch
        self.goals: set[int] = set()  # of this epoch
        self.delivered: list[tuple[int, Future[None]]] = []
        self.may_move = True  # whether a request of this epoch has been delivered
        self.stops = 0

    def make(self) -> None:
        tick = self.random.choice((None, self.random.randrange(600, 900)))
        if tick is not None:
            self.goals.add(tick)
        self.made.append((tick, self.epoch.value))

    def deliver(self) -> None:
        """Hand the oldest or the newest of what was made to the bus."""
        if not self.made:
            return
        tick, epoch = self.made.pop(self.random.choice((0, -1)))
        if epoch == self.epoch.value:
            self.may_move = True
        if tick is not None:
            try:
                self.bus.command({JOINT: Goal(PAN.position(tick))}, epoch=epoch)
            except StoppedError:
                assert epoch < self.epoch.value
            except DynamixelError:  # relaxed on request
                assert epoch == self.epoch.value
            return
        future = self.bus.requests.add(lambda: self.bus.switching_torque(None, True), epoch)
        self.delivered.append((epoch, future))

    def serve(self) -> None:
        self.bus.requests.begin_next()
        self.check()

    def cycle(self) -> None:
        self.bus.step()
        self.check()

    def stop(self) -> None:
        """STOP, by a thread that has the port, or by one that does not get it."""
        if self.random.random() < 0.5:
            assert set(self.bus.relax_at_once(1.0).values()) == {""}
        else:
            self.epoch.advance()
            self.bus.step()
        self.stops += 1
        self.may_move = False
        self.goals.clear()
        self.check()

    def relax(self) -> None:
        """Relax as a service does: it is carried out also if STOP overtakes it."""
        epoch = max(0, self.epoch.value - self.random.randrange(2))
        relaxing = self.bus.requests.add(
            lambda: self.bus.switching_torque(None, False), epoch, despite_stop=True
        )
        self.settle()
        assert relaxing.result(0.0) is None
        assert self.servo["Torque Enable"] == 0

    def resume(self) -> None:
        """Whatever was discarded before, the joint takes torque and a goal again."""
        self.made.clear()
        self.stop()
        self.settle()
        on = self.bus.requests.add(lambda: self.bus.switching_torque(None, True))
        self.may_move = True
        self.goals.add(700)
        self.settle()
        assert on.result(0.0) is None
        self.stop()
        self.may_move = True
        self.goals.add(700)
        self.bus.command({JOINT: Goal(PAN.position(700))})
        for _ in range(30):
            self.cycle()
        assert self.servo["Goal Position"] == 700

    def settle(self) -> None:
        requests = self.bus.requests
        for _ in range(2000):
            requests.begin_next()
            self.bus.step()
            if not (requests.has_waiting() or requests.under_way):
                break
        self.check()
        done, self.delivered = self.delivered, []
        for epoch, future in done:
            assert future.done()
            if epoch < self.epoch.value and future.exception() is not None:
                assert isinstance(future.exception(), (StoppedError, TorqueError))

    def check(self) -> None:
        servo = self.servo
        if servo["Torque Enable"]:
            assert self.may_move
            assert servo["Goal Position"] in {servo["Present Position"], *self.goals}
        elif not self.may_move:
            assert self.bus.joint(JOINT).torque is not Torque.ON


@pytest.mark.parametrize("seed", range(2))
def test_nothing_made_before_a_stop_switches_torque_on_after_it(seed):
    run = Interleavings(seed)
    choices = [run.make, run.deliver, run.serve, run.cycle, run.stop]
    for number in range(INTERLEAVINGS // 2):
        for act in run.random.choices(choices, (4, 4, 3, 3, 2), k=6):
            act()
        if number % 50 == 0:
            run.relax()
            run.settle()
            run.log.clear()
        if number % 500 == 0:
            run.resume()
    assert run.stops > INTERLEAVINGS // 8


def test_what_is_asked_after_stops_that_overlapped_is_carried_out(rig):
    first, second = rig.bus.requests.epoch.advance(), rig.bus.requests.epoch.advance()
    for epoch in (second, first):  # as the port became free
        assert set(rig.bus.relax_at_once(1.0, epoch).values()) == {""}
    run(rig.bus.switching_torque(None, True))
    rig.step(5)
    assert rig.torque == [1, 1]


def test_the_wait_for_a_joint_with_another_request_is_bounded(rig):
    submit(rig.bus, rig.bus.switching_torque([JOINT], True))
    for _ in range(4):
        rig.bus.cycle.fill(rig.bench.now() + 10**9)
    assert rig.bus.joint(JOINT).busy  # and no cycle takes the other steps
    with pytest.raises(ServoError):
        run(rig.bus.writing_eeprom(JOINT, EepromSettings()), rig.bench.pass_time)
    assert rig.bench.now() < 20e9


def test_the_servos_are_relaxed_at_the_end_also_if_a_request_fails_to_end(rig):
    run(rig.bus.switching_torque(None, True))

    def steps():
        try:
            while True:
                yield 0.0
        finally:
            raise RuntimeError("cannot end")

    submit(rig.bus, steps())
    assert rig.bus.close() == ()
    assert rig.torque == [0, 0]


# What an answer says is so when it comes; a request that fails changes nothing


@pytest.fixture
def holding():
    """Return a joint with torque on."""
    rig = Rig(SimulatedServo(1, "XM430-W350", boot_time=0.1))
    rig.go(0.3)
    return rig


def test_torque_is_called_on_when_it_is_on_though_the_bus_has_not_switched_it_off(holding):
    holding.servos[0].set_register("Torque Enable", 0)  # by another program
    on = submit(holding.bus, holding.bus.switching_torque(None, True))
    while not on.done():
        holding.step()
    assert on.exception() is None
    assert holding.torque == [1]


def test_a_joint_that_is_relaxed_while_its_torque_is_checked_stays_relaxed(holding):
    for steps in range(16):
        run(holding.bus.switching_torque(None, True), holding.bench.pass_time)
        holding.servos[0].set_register("Torque Enable", 0)
        submit(holding.bus, holding.bus.switching_torque(None, True))
        for _ in range(steps):
            holding.bus.cycle.fill(holding.bench.now() + 1_000_000_000)
        submit(holding.bus, holding.bus.switching_torque(None, False))
        holding.step(20)
        assert (holding.torque, holding.bus.joint("j1").torque) == ([0], Torque.OFF_ON_REQUEST), (
            steps
        )


# A request that fails


def stopped(holding: Rig) -> None:
    on = submit(holding.bus, holding.bus.switching_torque(None, True))
    holding.bus.cycle.fill(holding.bench.now() + 1_000_000_000)
    holding.bus.relax_at_once(1.0)
    assert isinstance(on.exception(0.0), StoppedError)


def cancelled(holding: Rig) -> None:
    assert submit(holding.bus, holding.bus.switching_torque(None, True)).cancel()


def silent(holding: Rig) -> None:
    holding.servos[0].power_off()
    holding.step(20)
    on = submit(holding.bus, holding.bus.switching_torque(None, True))
    holding.step(20)
    assert isinstance(on.exception(0.0), TorqueError)
    holding.servos[0].power_on()


@pytest.mark.parametrize("fails", [stopped, cancelled, silent])
def test_a_joint_that_was_relaxed_on_request_stays_so_if_its_torque_does_not_come_on(
    holding, fails
):
    run(holding.bus.switching_torque(None, False))
    fails(holding)
    holding.step(20)
    assert holding.bus.joint("j1").torque is Torque.OFF_ON_REQUEST
    with pytest.raises(GoalError, match="torque_enable"):
        holding.bus.command({"j1": Goal(0.1)})
    holding.step()
    assert holding.torque == [0]
    run(holding.bus.switching_torque(None, True))
    assert holding.go(0.1).states["j1"].position == pytest.approx(0.1, abs=0.02)


def test_resume_does_not_hold_a_joint_that_is_relaxed_at_the_same_time():
    """The bus executes both requests in one cycle."""
    bench, loop = Bench([SimulatedServo(1)]), ControlLoop(None)
    bus = bench.servo_bus([PAN], loop.owners.epoch)
    backend = DynamixelBackend([bus], loop, 50.0)
    backend.connect()
    run(bus.switching_torque(None, True))
    loop.attach(backend)
    assert not any(loop.stop().values())
    backend.call(None, lambda bus, names: bus.switching_torque(names, False), despite_stop=True)
    backend.resume()
    for _ in range(20):
        bus.requests.begin_next()
        bench.pass_time(0.02)
        bus.step()
    assert bench.torque == [0]
    assert bus.joint(PAN.joint_name).torque is Torque.OFF_ON_REQUEST
