"""The servos on the serial ports of this process, as the backend of a control loop."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from head_tracking.control.loop import ControlLoop, JointBackend
from head_tracking.dynamixel import (
    BusReading,
    BusStoppedError,
    BusThread,
    ConfigurationError,
    DynamixelError,
    Goal,
    GoalError,
    ServoBus,
    StoppedError,
    Torque,
)
from head_tracking.dynamixel.joint import BusJoint
from head_tracking.dynamixel.requests import Steps

_T = TypeVar("_T")
_STOP_TIME = 0.4  # s that servos may take to confirm a STOP

Observer = Callable[[ServoBus, BusReading], object]
Claim = Callable[[Iterable[str]], object]


class DynamixelBackend(JointBackend):
    """A `JointBackend`: servos on serial ports, each port in a thread that owns it.

    Args:
        buses: one for each port; they share the epoch of the loop's owners.
        loop: runs in each cycle between reading and writing, after `start`.
        rate: of the cycle [Hz].
        report: called with a joint or an owner, and why its goal was not set as requested.
        on_reading: called with a bus and each of its readings, after the write, in its thread.
        on_failure: called with the error that has ended a thread, in that thread.

    Raises:
        ConfigurationError: two buses have a joint or a controller of the same name, or one has
            another epoch.

    Attributes:
        threads: one for each bus.
    """

    def __init__(
        self,
        buses: Sequence[ServoBus],
        loop: ControlLoop,
        rate: float,
        report: Callable[[str, str], object] = lambda subject, text: None,
        on_reading: Observer = lambda bus, reading: None,
        on_failure: Callable[[BaseException], object] = lambda error: None,
    ) -> None:
        self.threads = tuple(
            BusThread(
                bus,
                rate,
                partial(self._after_write, bus),
                on_failure,
                partial(self._update, bus),
            )
            for bus in buses
        )
        self.period = 1.0 / rate
        self.joints = tuple(joint for bus in buses for joint in bus.joints)
        self._loop, self._report = loop, report
        self._on_reading = on_reading
        self._read: dict[ServoBus, Mapping[str, Any]] = {}
        self._names = {bus: tuple(joint.joint_name for joint in bus.joints) for bus in buses}
        self._by_joint = {
            name: thread for thread in self.threads for name in self._names[thread.bus]
        }
        controllers = {each.controller for each in self.joints}
        if min(len(self._by_joint), len(controllers)) < len(self.joints):
            raise ConfigurationError(
                "two serial ports have a joint or a controller of the same name"
            )
        if any(bus.requests.epoch is not loop.owners.epoch for bus in buses):
            raise ConfigurationError("every bus must have the epoch of the loop's owners")

    def connect(self, *, allow_missing: bool = False) -> None:
        """Connect all buses, or none; see `ServoBus.connect`."""
        with ExitStack() as connected:
            for thread in self.threads:
                thread.bus.connect(allow_missing=allow_missing)
                connected.callback(thread.bus.close)
            connected.pop_all()

    def start(self) -> None:
        """Start the cycles."""
        for thread in self.threads:
            thread.start()

    def close(self) -> list[str]:
        """Brake and relax the servos and close the ports of all buses, even if one fails.

        Returns:
            A sentence for each thread that did not end, and for each joint that did not confirm
            that it is relaxed.
        """
        for thread in self.threads:
            thread.ask_to_stop()
        problems: list[str] = []
        for thread in self.threads:
            try:
                thread.stop()
            except BusStoppedError as failure:
                problems.append(str(failure))
            for joint in thread.unconfirmed:
                problems.append(f"{joint} did not confirm that it is relaxed")
        return problems

    # Goals

    def write(
        self, owner: str, goals: Mapping[str, Goal], epoch: int, claim: Claim | None = None
    ) -> None:
        """Set goals, within the limits, of the joints that accept goals now; see `JointBackend`.

        None is set if a joint is unknown. For `claim` see `ServoBus.command`.
        """
        try:
            shares = self._by_bus(goals)
        except GoalError as error:
            self._report(owner, f"goals refused: {error}")
            return
        for thread, names in shares.items():
            share = {name: goals[name] for name in names}
            try:
                result = thread.bus.command(share, clamp=True, claim=claim, epoch=epoch)
            except DynamixelError as error:
                self._report(owner, f"goals refused: {error}")
                continue
            for name, reason in result.left_out.items():
                self._report(name, f"{reason}; goals of {owner} are ignored until then")
            for name in result.clamped:
                self._report(
                    name,
                    f"the goal {goals[name].position:.3f} rad is beyond the servo's limit; "
                    f"{result.goals[name].position:.3f} rad is used",
                )

    def command(self, joint: str, goal: Goal, epoch: int, claim: Claim) -> None:
        """Set the goal of one joint; see `ServoBus.command`."""
        (thread,) = self._by_bus([joint])
        thread.bus.command({joint: goal}, claim=claim, epoch=epoch)

    def servo(self, joint: str) -> str:
        """Return the adapter's serial number, the model and the id; see `JointBackend`."""
        thread = self._by_joint.get(joint)
        if thread is None or not thread.bus.port.stable_name:
            return ""
        servo = thread.bus.joint(joint).configuration
        return f"{Path(thread.bus.port.stable_name).name} {servo.model.name} {servo.id}"

    def limits(self, joint: str) -> tuple[float, float]:
        """Return the limits by configuration and memory of the servos; see `JointBackend`."""
        thread = self._by_joint.get(joint)
        return super().limits(joint) if thread is None else thread.bus.joint(joint).limits

    # Torque

    def joint(self, name: str) -> BusJoint:
        """Return the state of a joint; see `ServoBus.joint`."""
        (thread,) = self._by_bus([name])
        return thread.bus.joint(name)

    def call(
        self,
        joints: Iterable[str] | None,
        function: Callable[[ServoBus, tuple[str, ...]], Steps[_T] | _T],
        epoch: int | None = None,
        *,
        despite_stop: bool = False,
    ) -> list[Future[_T]]:
        """Run a function in the thread of each bus that has some of these joints.

        Args:
            joints: their names; None: all.
            function: called with a bus and the names of its joints.
            epoch: in which the request was made; None: now. See `RequestQueue.add`.
            despite_stop: run it also if STOP came after the request.

        Raises:
            GoalError: a joint is unknown; nothing was run.
        """
        if epoch is None:
            epoch = self._loop.owners.epoch.value

        shares = self._by_bus(self._by_joint if joints is None else joints)
        return [
            thread.bus.requests.add(partial(function, thread.bus, names), epoch, despite_stop)
            for thread, names in shares.items()
        ]

    def resume(self) -> tuple[tuple[str, ...], dict[str, str]]:
        """End a STOP: hold the joints that were not relaxed on request.

        Returns:
            The owners that continue, and why other joints refuse commands also without a STOP.

        Raises:
            StoppedError: there was another STOP meanwhile.
        """
        owners = self._loop.owners
        epoch = owners.epoch.value
        reasons = {name: self.joint(name).refusal for name in self._by_joint}
        refusals = {name: reason for name, reason in reasons.items() if reason}
        if not owners.stopped:
            return (), refusals
        resumed = owners.resume(epoch)
        holding: list[Future[None]] = self.call(None, _hold, epoch)
        for future in holding:
            future.add_done_callback(self._torque_switched)
        return resumed, refusals

    def _torque_switched(self, future: Future[None]) -> None:
        error = None if future.cancelled() else future.exception()
        if error is not None and not isinstance(error, StoppedError):
            self._report("resume", f"torque stays off: {error}")

    def relax_now(self, timeout: float = _STOP_TIME) -> dict[str, str]:
        """STOP: relax all joints of all buses without waiting for their threads.

        Args:
            timeout: time for the servos to confirm [s]; a little longer for the port to become
                free, because another STOP may have it.

        Returns:
            The problem of each joint; empty if its servos have confirmed.
        """
        epoch = self._loop.owners.epoch.advance()  # a thread that hangs relaxes its servos later
        problems: dict[str, str] = {}

        def relax(thread: BusThread) -> None:
            stop = partial(ServoBus.relax_at_once, timeout=timeout, epoch=epoch)
            try:
                problems.update(thread.at_once(stop, 1.1 * timeout))
            except Exception as cause:  # STOP of the other buses goes on
                problem = str(cause) or repr(cause)
                problems.update(dict.fromkeys(self._names[thread.bus], problem))

        # Ctrl-C here would leave the port of the bus locked; it cannot interrupt other threads
        helpers = [threading.Thread(target=relax, args=(each,)) for each in self.threads]
        for helper in helpers:
            helper.start()
        for helper in helpers:
            helper.join()
        return problems

    # The cycle, in the thread of a bus

    def _update(self, bus: ServoBus, reading: BusReading) -> None:
        states: Mapping[str, Any] = reading.states
        if states:
            states = self._loop.joints_read(reading.stamp, states)
        self._read[bus] = states
        self._loop.update(self._names[bus])

    def _after_write(self, bus: ServoBus, reading: BusReading) -> None:
        for event in reading.events:
            if event.stuck:
                self._loop.stuck[event.joint_name] = event.text
        self._on_reading(bus, reading)
        self._loop.publish(self._names[bus], reading.stamp, self._read[bus])

    def _by_bus(self, joints: Iterable[str]) -> dict[BusThread, tuple[str, ...]]:
        """Return the joints of each bus; raise GoalError if one is unknown."""
        found: dict[BusThread, tuple[str, ...]] = {}
        for name in joints:
            thread = self._by_joint.get(name)
            if thread is None:
                raise GoalError(
                    f"no joint {name!r} on any bus; there are {', '.join(self._by_joint)}"
                )
            found[thread] = (*found.get(thread, ()), name)
        return found


def _hold(bus: ServoBus, names: tuple[str, ...]) -> Steps[None]:
    """Switch the torque of joints on that were not relaxed on request."""
    held = [name for name in names if bus.joint(name).torque is Torque.OFF_UNTIL_COMMANDED]
    return bus.switching_torque(held, True)
