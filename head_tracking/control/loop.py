"""The control loop of a process: read the joints, update the controllers, write goals, publish."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, TypeAlias

from head_tracking.control.owners import JointOwners
from head_tracking.dynamixel import Goal

if TYPE_CHECKING:  # a process with a servo bus alone needs no transforms
    from head_tracking.transforms import JointSample, TransformBuffer


Completer: TypeAlias = "Callable[[Mapping[str, JointSample]], Mapping[str, JointSample]]"
Observer: TypeAlias = "Callable[[int, Mapping[str, JointSample]], object]"


class Controller:
    """Decides where joints go.

    Attributes:
        failure: the exception that has ended it; None as long as it works.
    """

    name: str
    joints: tuple[str, ...]
    failure: Exception | None = None

    def update(self) -> None:
        """Write goals for the joints, which have just been measured, if there are any."""
        raise NotImplementedError

    def publish(self) -> None:
        """Notify observers, after the goals were written."""


class JointBackend:
    """Drives joints: servos of this process, or another process by topics.

    Attributes:
        period: between two measurements of the joints [s]; 0: not known.
    """

    period = 0.0

    def start(self) -> None:
        """Start, after the controllers were added to the loop."""

    def close(self) -> object:
        """Stop; relax the servos of this process, and withdraw services."""

    def write(self, owner: str, goals: Mapping[str, Goal], epoch: int) -> None:
        """Send the goals of an owner, made in an epoch, to the joints; must not wait."""
        raise NotImplementedError

    def claim(self) -> None:
        """Report to a servo bus of another process that its joints have an owner here."""

    def servo(self, joint: str) -> str:
        """Return an identifier of a joint's servo that other runs know; empty: not known."""
        return ""

    def limits(self, joint: str) -> tuple[float, float]:
        """Return the lowest and highest position that a joint's servos allow [rad], if known."""
        return -math.inf, math.inf

    def relax_now(self) -> Mapping[str, str]:
        """Relax all joints and return the problem of each; empty: confirmed."""
        raise NotImplementedError


class ControlLoop:
    """The cycle of a process: who controls which joint, and what drives the joints.

    Args:
        buffer: the robot's frames; None: not needed in this process.
        owners: of the joints, and STOP.

    Attributes:
        backend: what drives the joints; None: nothing does yet.
        stuck: joints that cannot move as commanded, and why, as the servo bus of this process has
            diagnosed. A new motion removes its joints.
    """

    def __init__(self, buffer: TransformBuffer | None, owners: JointOwners | None = None) -> None:
        self.buffer = buffer
        self.owners = owners or JointOwners()
        self.backend: JointBackend | None = None
        self.stuck: dict[str, str] = {}
        self._complete: Completer = lambda measured: measured
        self._observers: list[Observer] = []
        self._controllers: list[Controller] = []

    @property
    def period(self) -> float:
        """Of a cycle [s]; 0: not known."""
        return 0.0 if self.backend is None else self.backend.period

    def attach(self, backend: JointBackend) -> None:
        """Let a backend drive the joints."""
        self.backend = backend

    def add(self, controller: Controller) -> None:
        """Update a controller from the next cycle on."""
        self._controllers.append(controller)

    def observe(self, observer: Observer) -> None:
        """Call an observer after each write, with the stamp [ns] and the complete joint states."""
        self._observers.append(observer)

    def complete_by(self, complete: Completer) -> None:
        """Set the function that adds joint states which follow from the measured ones."""
        self._complete = complete

    def stop(self) -> Mapping[str, str]:
        """STOP: relax all joints, and refuse everything until `resume`.

        Returns:
            The problem of each joint; empty if it has confirmed.
        """
        assert self.backend is not None
        return self.owners.stop(self.backend.relax_now)

    def joints_read(
        self, stamp: int, measured: Mapping[str, JointSample]
    ) -> Mapping[str, JointSample]:
        """Accept joints measured at `stamp` [ns]; return them with the states that follow."""
        states = self._complete(measured)
        if states and self.buffer is not None:
            positions = {name: state.position for name, state in states.items()}
            self.buffer.set_joint_positions(stamp, positions, measured=measured.keys())
        return states

    def update(self, joints: Iterable[str]) -> None:
        """Update the controllers of joints that have just been measured."""
        for controller in self._controllers:
            if controller.joints[0] in joints and controller.failure is None:
                try:
                    controller.update()
                except Exception as error:  # the program ends; until then the head holds
                    controller.failure = error

    def publish(self, joints: Iterable[str], stamp: int, states: Mapping[str, JointSample]) -> None:
        """Notify observers and controllers, after the write, of joints measured at `stamp` [ns]."""
        if states:
            for observer in self._observers:
                observer(stamp, states)
        for controller in self._controllers:
            if controller.joints[0] in joints:
                controller.publish()

    def heard(self, joints: Iterable[str]) -> None:
        """Run a cycle for joints of another process, whose states the buffer has received."""
        self.update(joints)
        self.publish(joints, 0, {})
