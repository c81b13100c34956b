"""Requests, faults, power and cables in any order, against a model of what a person expects.

The model knows four independent facts of each joint. Whatever happens, torque is on only where all
of them allow it and a command came, nothing moves that nobody commanded, and relaxing works.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from random import Random

import pytest
from dynamixel_fakes import submit
from simulated_device import Rig, joint_of

from head_tracking.dynamixel import (
    DynamixelError,
    Goal,
    GoalError,
    Torque,
    servo_model,
)
from head_tracking.dynamixel.servo import run
from head_tracking.simulation import SimulatedServo

PERIOD = 0.02
SETTLING = 60  # cycles after which everything that goes on by itself has been done


@dataclass
class Expected:
    """What a person knows of a joint."""

    relaxed: bool = False  # on request
    stopped: bool = False
    faulted: bool = False
    powered: bool = True
    wanted: bool = False  # torque: a command or torque_enable came since it was last off

    @property
    def takes_commands(self) -> bool:
        return not (self.relaxed or self.stopped or self.faulted)

    def off(self) -> None:
        self.wanted = False


LINES = [
    ("AX-12", "XM430-W350"),
    ("XL-320", "MX-28"),
    ("STS3215", "STS3032"),
]
"""Models that share a line."""


class Requests:
    """Two joints on one line.

    Args:
        names: of the models of their servos.
        seed: of what happens.
    """

    def __init__(self, names: tuple[str, str], seed: int = 0) -> None:
        self.random = Random(seed)
        models = [servo_model(name) for name in names]
        self.servos = {
            f"j{i}": SimulatedServo(i, model, boot_time=0.05)
            for i, model in enumerate(models, start=1)
        }
        joints = [joint_of(*each) for each in enumerate(models, start=1)]
        rig = Rig(*self.servos.values(), joints=joints)
        self.bench, self.bus = rig.bench, rig.bus
        self.expected = {name: Expected() for name in self.servos}
        self.plugged = True
        self.settle()

    def act(self) -> None:
        """Let something happen, and check what must always be so."""
        random = self.random
        name = random.choice(["j1", "j2"])
        chosen = random.choice([None, [name]])
        acts = [
            lambda: self.step(random.randint(1, 30)),
            lambda: self.relax(chosen, random.random() < 0.5),
            lambda: self.torque_on(chosen, random.randint(0, 12)),
            lambda: self.stop(chosen),
            lambda: self.start(chosen),
            lambda: self.recover(chosen),
            lambda: self.command(name, random.uniform(-0.8, 0.8)),
            lambda: self.overload(name),
            lambda: self.cut_power(name),
            lambda: self.give_power(name),
            self.unplug,
            self.plug_in,
        ]
        random.choices(acts, (1, 2, 3, 2, 2, 2, 4, 2, 1, 2, 1, 3))[0]()
        self.check()

    # What happens by itself

    def step(self, count: int = 1) -> None:
        for _ in range(count):
            self.bench.pass_time(PERIOD)
            reading = self.bus.step()
            if not self.plugged:
                assert not reading.states

    def settle(self) -> None:
        self.step(SETTLING)

    # Requests

    def relax(self, chosen: list[str] | None, at_once: bool) -> None:
        for name in chosen or self.expected:
            self.expected[name].relaxed = True
            self.expected[name].off()
        if at_once:
            with suppress(DynamixelError):
                run(self.bus.switching_torque(chosen, False))
        else:
            submit(self.bus, self.bus.switching_torque(chosen, False))
            self.step(2)
        for name in chosen or self.expected:
            if self.plugged and self.expected[name].powered:
                assert self.servos[name].register("Torque Enable") == 0

    def torque_on(self, chosen: list[str] | None, cycles: int) -> None:
        future = submit(self.bus, self.bus.switching_torque(chosen, True))
        self.step(cycles)
        if not future.done() and cycles % 2:
            assert future.cancel()  # whoever asked has given up
            self.settle()
            for name in chosen or self.expected:
                expected = self.expected[name]
                if not (expected.stopped or expected.faulted):
                    expected.relaxed = self.bus.joint(name).relaxed
                expected.wanted = self.bus.joint(name).torque is Torque.ON
            return
        self.settle()
        assert future.done()
        for name in chosen or self.expected:
            expected = self.expected[name]
            if not (expected.stopped or expected.faulted):
                expected.relaxed = False
                reachable = self.plugged and expected.powered
                expected.wanted = expected.wanted or reachable

    def stop(self, chosen: list[str] | None) -> None:
        with suppress(DynamixelError):
            run(self.bus.stopping(chosen))
        for name in chosen or self.expected:
            self.expected[name].stopped = True
            self.expected[name].off()

    def start(self, chosen: list[str] | None) -> None:
        with suppress(DynamixelError):
            run(self.bus.starting(chosen))
        for name in chosen or self.expected:
            self.expected[name].stopped = False
        self.settle()

    def recover(self, chosen: list[str] | None) -> None:
        self.settle()
        with suppress(DynamixelError):
            run(self.bus.recovering(chosen))
        for name in chosen or self.expected:
            expected = self.expected[name]
            if self.plugged and expected.powered and expected.faulted:
                expected.faulted = False
                expected.off()
        self.settle()

    def command(self, name: str, position: float) -> None:
        expected = self.expected[name]
        try:
            self.bus.command({name: Goal(position, 2.0)})
        except GoalError as refusal:
            reachable = self.plugged and expected.powered
            assert not (expected.takes_commands and reachable and self.settled(name)), refusal
            return
        assert expected.takes_commands
        self.settle()
        if self.plugged and expected.powered:
            expected.wanted = True

    def settled(self, name: str) -> bool:
        """Whether the bus has had the time to find a servo that is there."""
        self.settle()
        self.bus.step()
        return not self.bus.joint(name).lost

    # The world

    def overload(self, name: str) -> None:
        expected = self.expected[name]
        if not expected.powered or expected.stopped or not self.plugged:
            return
        self.servos[name].overload()
        self.settle()
        expected.faulted = True
        expected.off()

    def cut_power(self, name: str) -> None:
        if self.expected[name].powered:
            self.servos[name].power_off()
            self.expected[name].powered = False
            self.expected[name].off()
            self.settle()

    def give_power(self, name: str) -> None:
        if not self.expected[name].powered:
            self.servos[name].power_on()
            self.expected[name].powered = True
            self.settle()
            if self.plugged and not self.expected[name].stopped:
                self.expected[name].faulted = False  # it starts with its memory's torque limit

    def unplug(self) -> None:
        self.plugged = self.bench.line.plugged = False
        self.step(2)

    def plug_in(self) -> None:
        self.plugged = self.bench.line.plugged = True
        self.settle()
        for name, expected in self.expected.items():
            joint = self.bus.joint(name)
            if expected.powered and not expected.stopped:
                # What happened to its power meanwhile, only the servo knows.
                expected.faulted = joint.faulted
                expected.wanted = expected.wanted and joint.on

    # What must always be so

    def check(self) -> None:
        """Whether facts are what a person expects."""
        if not self.plugged:
            return
        self.settle()
        for name, expected in self.expected.items():
            joint, servo = self.bus.joint(name), self.servos[name]
            assert joint.stopped == expected.stopped, name
            assert joint.relaxed == expected.relaxed, name
            if expected.powered and not expected.stopped:
                assert joint.faulted == expected.faulted, name
            powered = servo.register("Torque Enable") == 1 and expected.powered
            assert joint.on <= expected.wanted, name
            if powered:
                assert expected.wanted and expected.takes_commands, name
                assert joint.on, name


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("names", LINES, ids="+".join)
def test_requests_in_any_order_do_what_a_person_expects(names: tuple[str, str], seed: int) -> None:
    requests = Requests(names, seed)
    for _ in range(25):
        requests.act()


def test_what_is_stopped_while_the_adapter_is_out_is_relaxed_when_it_comes_back() -> None:
    requests = Requests(("AX-12", "XM430-W350"))
    requests.command("j1", 0.0)
    requests.unplug()
    requests.stop(None)
    requests.plug_in()
    requests.check()
