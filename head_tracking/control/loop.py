"""Read, update, write: the controllers of a process, driven by what the joints measure.

read     the servo bus reads the joints, or joint states come from another process
update   the joint history takes them; each controller is asked for its goals
write    the goals are written in the same cycle, or sent
publish  what others may want to know, after the write, so that it delays nothing
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Protocol

from head_tracking.control.owners import JointOwners
from head_tracking.dynamixel import Goal

if TYPE_CHECKING:  # a servo bus alone in its process needs no transforms
    from head_tracking.transforms import JointSample, TransformBuffer


class Controller(Protocol):
    """Turns joints to where it wants them.

    Attributes:
        failure: what has ended it; None as long as it works.
    """

    failure: Exception | None

    @property
    def name(self) -> str:
        """Who it is."""

    @property
    def joints(self) -> tuple[str, ...]:
        """What it turns."""

    def update(self) -> None:
        """Looks at the joints as they were just read, and sends goals if it has any."""

    def publish(self) -> None:
        """Tells others what has come of it."""


class ControlLoop:
    """What a process does in each cycle, and who in it may turn which joint.

    Args:
        buffer: the robot's frames; None: nobody here needs them.
        owners: of the joints, and STOP.

    Attributes:
        complete: adds to measured joint states what follows from them, and what is stated.
        period: of a cycle [s]; 0: not known.
        driven: whether a servo bus of this process, or what listens to another one, runs the cycle.
        held: why the controllers may move nothing now; empty: they may.
        stuck: joints that cannot go where they are told, and why, as the servo bus of this process
            has found out; who begins a motion takes its joints out.
        after: called after the goals were written, with the stamp [ns] and the complete states.
    """

    def __init__(self, buffer: TransformBuffer | None, owners: JointOwners | None = None) -> None:
        self.buffer = buffer
        self.owners = owners or JointOwners()
        self.complete: Callable[[Mapping[str, JointSample]], Mapping[str, JointSample]] = (
            lambda measured: measured
        )
        self._write: Callable[[str, Mapping[str, Goal], int], object] | None = None
        self._claim: Callable[[], object] = lambda: None
        self.driven = False
        self.held = ""
        self.stuck: dict[str, str] = {}
        self.period = 0.0
        self.after: list[Callable[[int, Mapping[str, JointSample]], object]] = []
        self._controllers: tuple[Controller, ...] = ()
        self._lock = threading.Lock()

    @property
    def controllers(self) -> tuple[Controller, ...]:
        """Those of this process."""
        return self._controllers

    def add(self, controller: Controller) -> None:
        """Lets a controller take part from the next cycle on."""
        with self._lock:
            self._controllers += (controller,)

    @property
    def has_driver(self) -> bool:
        """Whether anything drives the joints yet."""
        return self._write is not None

    def drive_by(
        self,
        write: Callable[[str, Mapping[str, Goal], int], object],
        claim: Callable[[], object] = lambda: None,
    ) -> None:
        """Set what drives the joints.

        Args:
            write: takes the goals of an owner, by its name, to the servos, with the epoch in which
                they were made.
            claim: lets a servo bus of another process know that an owner here takes its joints.
        """
        self._write, self._claim = write, claim

    def write(self, owner: str, goals: Mapping[str, Goal], epoch: int) -> None:
        """Take the goals of an owner, made in an epoch, to the servos."""
        assert self._write is not None
        self._write(owner, goals, epoch)

    def take_over(self, owner: str, joints: Iterable[str], epoch: int) -> None:
        """Give joints to an owner here, whoever had them; see `JointOwners`."""
        self.owners.take_over(owner, joints, epoch)
        self._claim()

    def joints_read(
        self, stamp: int, measured: Mapping[str, JointSample]
    ) -> Mapping[str, JointSample]:
        """Takes joints as they were measured at `stamp` [ns]; these, and what follows from them."""
        states = self.complete(measured)
        if states and self.buffer is not None:
            self.buffer.set_joint_positions(
                stamp, {name: state.position for name, state in states.items()}
            )
        return states

    def update(self, joints: Iterable[str]) -> None:
        """Asks the controllers of these joints, which have just been asked where they are."""
        for controller in self._controllers:
            if controller.joints[0] in joints and controller.failure is None:
                try:
                    controller.update()
                except Exception as error:
                    # whoever runs the nodes ends the program; until then the head holds
                    controller.failure = error

    def publish(self, joints: Iterable[str], stamp: int, states: Mapping[str, JointSample]) -> None:
        """Tells others, after the write.

        Args:
            joints: those that were asked where they are.
            stamp: when [ns].
            states: what `joints_read` has made of it.
        """
        if states:
            for tell in self.after:
                tell(stamp, states)
        for controller in self._controllers:
            if controller.joints[0] in joints:
                controller.publish()

    def heard(self, joints: Iterable[str]) -> None:
        """Runs the cycle for joints of another process, unless something else runs it."""
        if not self.driven:
            self.update(joints)
            self.publish(joints, 0, {})

    def hold(self, reason: str) -> None:
        """Keeps the controllers from moving anything, and says why; or ends that, if empty."""
        self.held = reason
