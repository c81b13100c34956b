"""Read, update, write: the controllers of a process, driven by what the joints measure.

read     the servo bus reads the joints, or joint states come from another process
update   the joint history takes them; each controller is asked for its goals
write    the goals are written in the same cycle, or sent
publish  what others may want to know, after the write, so that it delays nothing
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Protocol, TypeAlias

from head_tracking.control.owners import JointOwners
from head_tracking.dynamixel import Goal

if TYPE_CHECKING:  # a servo bus alone in its process needs no transforms
    from head_tracking.transforms import JointSample, TransformBuffer


Completer: TypeAlias = "Callable[[Mapping[str, JointSample]], Mapping[str, JointSample]]"
Observer: TypeAlias = "Callable[[int, Mapping[str, JointSample]], object]"


class Controller(Protocol):
    """Decides where joints go.

    Attributes:
        failure: what has ended it; None as long as it works.
    """

    failure: Exception | None

    @property
    def name(self) -> str:
        """The owner that it is."""

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that it turns."""

    def update(self) -> None:
        """Decide by the joints as they were just read, and write goals, if there are any."""

    def publish(self) -> None:
        """Let others know, after the write."""


class JointBackend(Protocol):
    """What drives joints: servos of this process, or another process by topics.

    Attributes:
        period: between two readings of the joints [s]; 0: not known.
    """

    period: float

    def start(self) -> None:
        """Begin, after the controllers were added to the loop."""

    def close(self) -> object:
        """End: relax the servos of this process, and withdraw what was offered."""

    def write(self, owner: str, goals: Mapping[str, Goal], epoch: int) -> None:
        """Take the goals of an owner, made in an epoch, to the joints; must not wait."""

    def claim(self) -> None:
        """Let a servo bus of another process know that its joints have an owner here."""

    def servo(self, joint: str) -> str:
        """Return what identifies the servo of a joint in another run; empty: that is not known."""

    def relax_now(self) -> Mapping[str, str]:
        """Relax all joints and return what went wrong, for each joint; empty: confirmed."""


class ControlLoop:
    """What a process does in each cycle, and who in it may turn which joint.

    Args:
        buffer: the robot's frames; None: nobody here needs them.
        owners: of the joints, and STOP.

    Attributes:
        buffer: as given.
        owners: the same.
        stuck: joints that cannot go where they are commanded, and why, as the servo bus of this
            process has found out; who begins a motion takes its joints out.
    """

    def __init__(self, buffer: TransformBuffer | None, owners: JointOwners | None = None) -> None:
        self.buffer = buffer
        self.owners = owners or JointOwners()
        self.stuck: dict[str, str] = {}
        self._backend: JointBackend | None = None
        self._complete: Completer = lambda measured: measured
        self._observers: tuple[Observer, ...] = ()
        self._controllers: tuple[Controller, ...] = ()
        self._lock = threading.Lock()

    @property
    def controllers(self) -> tuple[Controller, ...]:
        """Those of this process."""
        return self._controllers

    @property
    def backend(self) -> JointBackend | None:
        """What drives the joints; None: nothing does yet."""
        return self._backend

    @property
    def period(self) -> float:
        """Of a cycle [s]; 0: not known."""
        return 0.0 if self._backend is None else self._backend.period

    def attach(self, backend: JointBackend) -> None:
        """Let a backend drive the joints."""
        self._backend = backend

    def add(self, controller: Controller) -> None:
        """Let a controller take part from the next cycle on."""
        with self._lock:
            self._controllers += (controller,)

    def observe(self, observer: Observer) -> None:
        """Call back after the goals were written: with the stamp [ns] and the complete states."""
        with self._lock:
            self._observers += (observer,)

    def complete_by(self, complete: Completer) -> None:
        """Set what adds to measured joint states what follows from them, and what is stated."""
        self._complete = complete

    def write(self, owner: str, goals: Mapping[str, Goal], epoch: int) -> None:
        """Take the goals of an owner, made in an epoch, to the joints."""
        assert self._backend is not None
        self._backend.write(owner, goals, epoch)

    def take_over(self, owner: str, joints: Iterable[str], epoch: int) -> None:
        """Give joints to an owner here, whoever had them; see `JointOwners`."""
        self.owners.take_over(owner, joints, epoch)
        if self._backend is not None:
            self._backend.claim()

    def stop(self) -> Mapping[str, str]:
        """STOP: relax all joints, and refuse everything until `resume`.

        Returns:
            For each joint what went wrong; empty where that is confirmed.
        """
        assert self._backend is not None
        return self.owners.stop(self._backend.relax_now)

    def joints_read(
        self, stamp: int, measured: Mapping[str, JointSample]
    ) -> Mapping[str, JointSample]:
        """Accept joints measured at `stamp` [ns]; return them and what follows from them."""
        states = self._complete(measured)
        if states and self.buffer is not None:
            self.buffer.set_joint_positions(
                stamp, {name: state.position for name, state in states.items()}
            )
        return states

    def update(self, joints: Iterable[str]) -> None:
        """Let the controllers of these joints, which have just been read, decide."""
        for controller in self._controllers:
            if controller.joints[0] in joints and controller.failure is None:
                try:
                    controller.update()
                except Exception as error:
                    # whoever runs the nodes ends the program; until then the head holds
                    controller.failure = error

    def publish(self, joints: Iterable[str], stamp: int, states: Mapping[str, JointSample]) -> None:
        """Let others know, after the write.

        Args:
            joints: those that were read.
            stamp: when [ns].
            states: what `joints_read` has made of it.
        """
        if states:
            for observer in self._observers:
                observer(stamp, states)
        for controller in self._controllers:
            if controller.joints[0] in joints:
                controller.publish()

    def heard(self, joints: Iterable[str]) -> None:
        """Run the cycle for joints of another process, whose states the buffer has received."""
        self.update(joints)
        self.publish(joints, 0, {})
