"""The servos of one serial port or several, as what drives the joints of a loop."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import ExitStack
from functools import partial
from typing import Any, TypeVar

from head_tracking.control.loop import ControlLoop
from head_tracking.dynamixel import (
    BusReading,
    BusStoppedError,
    BusThread,
    CommandResult,
    ConfigurationError,
    DynamixelError,
    Goal,
    GoalError,
    ServoBus,
    StoppedError,
    Torque,
)
from head_tracking.dynamixel.joint import Joint
from head_tracking.dynamixel.requests import Steps

_T = TypeVar("_T")
_STOP_TIME = 0.4  # s that servos may take to confirm a STOP

Observer = Callable[[ServoBus, BusReading], object]
Claim = Callable[[Iterable[str]], object]


class DynamixelBackend:
    """A `JointBackend`: servos on serial ports, each port in a thread that owns it.

    Args:
        buses: one for each port; they share the epoch of the loop's owners.
        loop: run in each cycle between reading and writing, once `start` is called.
        rate: of the cycle [Hz].
        report: called with a joint, or an owner, and what was not done as it was asked for.

    Raises:
        ConfigurationError: two buses have a joint or a controller of the same name, one has another
            epoch, or the rate is not possible.

    Attributes:
        period: of the cycle [s].
        joints: the configured joints of all buses.
        threads: one for each bus.
        measured: set as soon as a joint has been measured.
    """

    def __init__(
        self,
        buses: Sequence[ServoBus],
        loop: ControlLoop,
        rate: float,
        report: Callable[[str, str], object] = lambda subject, text: None,
    ) -> None:
        self.threads = tuple(
            BusThread(
                bus, rate, partial(self._after_write, bus), self._fail, partial(self._update, bus)
            )
            for bus in buses
        )
        self.period = 1.0 / rate
        self.joints = tuple(joint for bus in buses for joint in bus.joints)
        self.measured = threading.Event()
        self._loop, self._report = loop, report
        self._on_reading: Observer = lambda bus, reading: None
        self._on_failure: Callable[[BaseException], object] = lambda error: None
        self._read: dict[ServoBus, tuple[int, Mapping[str, Any]]] = {}
        self._names = {bus: tuple(joint.joint_name for joint in bus.joints) for bus in buses}
        self._by_joint = {
            name: thread for thread in self.threads for name in self._names[thread.bus]
        }
        if len(self._by_joint) + len({each.controller for each in self.joints}) < 2 * len(
            self.joints
        ):
            raise ConfigurationError(
                "two serial ports have a joint or a controller of the same name"
            )
        if any(bus.epoch is not loop.owners.epoch for bus in buses):
            raise ConfigurationError("every bus must have the epoch of the loop's owners")

    def connect(self, *, allow_missing: bool = False) -> None:
        """Connect all buses, or none; see `ServoBus.connect`."""
        with ExitStack() as connected:
            for thread in self.threads:
                thread.bus.connect(allow_missing=allow_missing)
                connected.callback(thread.bus.close)
            connected.pop_all()

    def start(
        self,
        on_reading: Observer = lambda bus, reading: None,
        on_failure: Callable[[BaseException], object] = lambda error: None,
    ) -> None:
        """Run the cycles from now on.

        Args:
            on_reading: called with a bus and each of its readings after the goals were written, in
                its thread.
            on_failure: called with the error that has ended a thread, in that thread.
        """
        self._on_reading, self._on_failure = on_reading, on_failure
        for thread in self.threads:
            thread.start()

    def close(self) -> tuple[str, ...]:
        """Brake and relax the servos and close the ports of all buses, whatever one does.

        Returns:
            Joints that did not confirm that they are relaxed.

        Raises:
            BusStoppedError: a thread did not end; says which, and whether its servos are relaxed.
        """
        for thread in self.threads:
            thread.ask_to_stop()
        failures: list[str] = []
        for thread in self.threads:
            try:
                thread.stop()
            except BusStoppedError as failure:
                failures.append(str(failure))
        unconfirmed = tuple(joint for thread in self.threads for joint in thread.unconfirmed)
        if failures:
            failures += [f"{joint} did not confirm that it is relaxed" for joint in unconfirmed]
            raise BusStoppedError("; ".join(failures))
        return unconfirmed

    # Goals

    def write(
        self, owner: str, goals: Mapping[str, Goal], epoch: int, claim: Claim | None = None
    ) -> None:
        """See `JointBackend`. Limits clamp the goals; joints that take none now are left out.

        Args:
            owner: whose goals they are.
            goals: by joint.
            epoch: in which they were made.
            claim: see `ServoBus.command`.
        """
        try:
            result = self.command(goals, clamp=True, claim=claim, epoch=epoch)
        except DynamixelError as error:
            self._report(owner, f"goals refused: {error}")
            return
        for name, reason in result.left_out.items():
            self._report(name, f"{reason}; the goals of {owner} do nothing until then")
        for name in result.clamped:
            self._report(
                name,
                f"the goal {goals[name].position:.3f} rad is beyond the servo's limit; "
                f"{result.positions[name]:.3f} rad is used",
            )

    def command(
        self,
        goals: Mapping[str, Goal],
        *,
        clamp: bool = False,
        claim: Claim | None = None,
        epoch: int | None = None,
    ) -> CommandResult:
        """Set the goals of some joints; see `ServoBus.command`. All or none on each bus.

        Raises:
            GoalError: a joint is unknown, and nothing has changed; or a bus refuses.
            StoppedError: STOP came after the command was made.
            NotConnectedError: a bus is not connected.
        """
        if epoch is None:
            epoch = self._loop.owners.epoch.value
        result = CommandResult({}, {}, {})
        refusals: list[str] = []
        for thread, names in self._shares(goals).items():
            share = {name: goals[name] for name in names}
            try:
                part = thread.bus.command(share, clamp=clamp, claim=claim, epoch=epoch)
            except GoalError as refusal:
                refusals.append(str(refusal))
            else:
                result = CommandResult(
                    {**result.positions, **part.positions},
                    {**result.clamped, **part.clamped},
                    {**result.left_out, **part.left_out},
                )
        if refusals:
            raise GoalError("; ".join(refusals))
        return result

    def claim(self) -> None:
        """See `JointBackend`; the owners of this process are those of its servos."""

    def servo(self, joint: str) -> str:
        """See `JointBackend`: the adapter's serial number, the model and the id."""
        thread = self._by_joint.get(joint)
        return "" if thread is None else thread.bus.servo_name(joint)

    # Torque

    def joint(self, name: str) -> Joint:
        """Return a joint, to look at; see `ServoBus.joint`."""
        (thread,) = self._shares([name])
        return thread.bus.joint(name)

    @property
    def holds(self) -> bool:
        """Whether the torque of all joints is on."""
        return all(
            thread.bus.joint(name).torque is Torque.ON for name, thread in self._by_joint.items()
        )

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
            joints: which; None: all.
            function: called with the bus and its share of the joints.
            epoch: when the request was made; None: now. See `BusThread.call`.
            despite_stop: whether it is carried out although STOP came after it.

        Raises:
            GoalError: a joint is unknown; nothing was run.
        """
        if epoch is None:
            epoch = self._loop.owners.epoch.value

        def ask(thread: BusThread, share: tuple[str, ...]) -> Future[_T]:
            return thread.call(lambda bus: function(bus, share), epoch, despite_stop=despite_stop)

        shares = self._shares(self._by_joint if joints is None else joints)
        return [ask(thread, share) for thread, share in shares.items()]

    def switch_torque(
        self, joints: Iterable[str] | None, on: bool, epoch: int | None = None
    ) -> list[Future[None]]:
        """Begin to switch the torque of joints, or of all (None); return what each bus does.

        Args:
            joints: which.
            on: on or off; off is done although there was a STOP.
            epoch: when it was asked for; None: now.
        """
        return self.call(
            joints, lambda bus, share: bus.switching_torque(share, on), epoch, despite_stop=not on
        )

    def resume(self) -> tuple[str, ...]:
        """End a STOP: hold what was not relaxed on request; return the owners that go on.

        Raises:
            StoppedError: there was another STOP meanwhile.
        """
        owners = self._loop.owners
        epoch = owners.epoch.value
        if not owners.stopped:
            return ()
        resumed = owners.resume(epoch)
        holding = [
            name
            for name, thread in self._by_joint.items()
            if thread.bus.joint(name).torque is Torque.OFF_UNTIL_COMMANDED
        ]
        for future in self.switch_torque(holding, True, epoch):
            future.add_done_callback(self._torque_done)
        return resumed

    def _torque_done(self, future: Future[None]) -> None:
        error = None if future.cancelled() else future.exception()
        if error is not None and not isinstance(error, StoppedError):
            self._report("resume", f"torque stays off: {error}")

    def relax_now(self, timeout: float = _STOP_TIME) -> dict[str, str]:
        """STOP: relax all joints of all buses, whatever their threads do; for any thread.

        Args:
            timeout: how long servos may take to confirm [s].

        Returns:
            For each joint what went wrong; empty where its servos have confirmed.
        """
        epoch = self._loop.owners.epoch.advance()  # first: a thread that hangs relaxes later
        problems: dict[str, str] = {}

        def relax(thread: BusThread) -> None:
            stop = partial(ServoBus.relax_at_once, timeout=timeout, epoch=epoch)
            try:
                problems.update(thread.at_once(stop, timeout / 2))
            except DynamixelError as cause:
                problems.update(dict.fromkeys(self._names[thread.bus], str(cause)))

        helpers = [threading.Thread(target=relax, args=(each,)) for each in self.threads[1:]]
        for helper in helpers:
            helper.start()
        relax(self.threads[0])
        for helper in helpers:
            helper.join()
        return problems

    # The cycle, in the thread of a bus

    def _update(self, bus: ServoBus, reading: BusReading) -> None:
        states = reading.states
        self._read[bus] = 0, {}
        if states:
            stamp = sum([state.stamp for state in states.values()]) // len(states)
            self._read[bus] = stamp, self._loop.joints_read(stamp, states)
        self._loop.update(self._names[bus])

    def _after_write(self, bus: ServoBus, reading: BusReading) -> None:
        for event in reading.events:
            if event.stuck:
                self._loop.stuck[event.joint_name] = event.text
        self._on_reading(bus, reading)
        self._loop.publish(self._names[bus], *self._read[bus])
        if reading.states:
            self.measured.set()

    def _fail(self, error: BaseException) -> None:
        self._on_failure(error)

    def _shares(self, joints: Iterable[str]) -> dict[BusThread, tuple[str, ...]]:
        """Return the joints of each bus; raise GoalError if one is unknown."""
        shares: dict[BusThread, tuple[str, ...]] = {}
        for name in joints:
            thread = self._by_joint.get(name)
            if thread is None:
                raise GoalError(
                    f"no joint {name!r} on any bus; there are {', '.join(self._by_joint)}"
                )
            shares[thread] = (*shares.get(thread, ()), name)
        return shares
