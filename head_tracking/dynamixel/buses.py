"""Several buses that look like one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from functools import partial
from typing import TypeVar

from head_tracking.dynamixel.bus_thread import BusThread
from head_tracking.dynamixel.command import CommandResult, Goal, Torque
from head_tracking.dynamixel.configuration import JointConfiguration
from head_tracking.dynamixel.exceptions import ConfigurationError, GoalError
from head_tracking.dynamixel.servo_bus import ServoBus
from head_tracking.dynamixel.servo_state import BusReading

_T = TypeVar("_T")


class Buses:
    """Runs each bus in a thread of its own and finds the bus of a joint.

    Args:
        buses: The buses.
        update_rate: Cycles per second.
        on_reading: Gets the bus and each of its readings, in its thread; see `BusThread`.
        on_error: Gets the exception that ended a thread, in that thread.

    Raises:
        ConfigurationError: Two buses have a joint or a controller of the same name.
    """

    def __init__(
        self,
        buses: Sequence[ServoBus],
        update_rate: float,
        on_reading: Callable[[ServoBus, BusReading], object],
        on_error: Callable[[BaseException], object],
    ) -> None:
        self._threads = [
            (bus, BusThread(bus, update_rate, partial(on_reading, bus), on_error)) for bus in buses
        ]
        self._by_joint: dict[str, tuple[ServoBus, BusThread]] = {}
        controllers: set[str] = set()
        for bus, thread in self._threads:
            for joint in bus.joints:
                if joint.joint_name in self._by_joint or joint.controller in controllers:
                    raise ConfigurationError(
                        f"{joint.joint_name} ({joint.controller}) is on two buses"
                    )
                self._by_joint[joint.joint_name] = (bus, thread)
                controllers.add(joint.controller)

    @property
    def threads(self) -> Sequence[tuple[ServoBus, BusThread]]:
        """Each bus and its thread."""
        return self._threads

    @property
    def joints(self) -> tuple[JointConfiguration, ...]:
        """The configured joints of all buses."""
        return tuple(joint for bus, _ in self._threads for joint in bus.joints)

    def bus_of(self, joint: str) -> ServoBus:
        """Return the bus of a joint; raises GoalError if it is unknown."""
        return self._find(joint)[0]

    def torque(self, joint: str) -> Torque:
        """Return the torque of a joint; raises GoalError if it is unknown."""
        return self._find(joint)[0].torque(joint)

    def start(self) -> None:
        """Start the cycles of all buses."""
        for _, thread in self._threads:
            thread.start()

    def stop(self) -> tuple[str, ...]:
        """End the cycles, relax the servos, close the ports.

        Returns:
            Joints that did not confirm that they are relaxed.
        """
        for _, thread in self._threads:
            thread.stop()
        return tuple(joint for _, thread in self._threads for joint in thread.unconfirmed)

    def command(self, goals: Mapping[str, Goal], *, clamp: bool = False) -> CommandResult:
        """Set the goals of some joints; see `ServoBus.command`. All or none on each bus.

        Raises:
            GoalError: A joint is unknown, and nothing has changed; or a bus refuses.
            NotConnectedError: A bus is not connected.
        """
        shares: dict[ServoBus, dict[str, Goal]] = {}
        for name, goal in goals.items():
            bus = self.bus_of(name) if len(self._threads) > 1 else self._threads[0][0]
            shares.setdefault(bus, {})[name] = goal
        results: list[CommandResult] = []
        refusals: list[str] = []
        for bus, share in shares.items():
            try:
                results.append(bus.command(share, clamp=clamp))
            except GoalError as refusal:
                refusals.append(str(refusal))
        if refusals:
            raise GoalError("; ".join(refusals))
        return CommandResult(
            {name: value for result in results for name, value in result.positions.items()},
            {name: value for result in results for name, value in result.clamped.items()},
            tuple(name for result in results for name in result.lost),
        )

    def call(
        self,
        joints: Iterable[str] | None,
        function: Callable[[ServoBus, tuple[str, ...]], _T],
    ) -> list[Future[_T]]:
        """Run a function in the owner's thread of each bus that has some of these joints.

        Args:
            joints: The joints; None for all.
            function: Gets the bus and its share of the joints.

        Raises:
            GoalError: A joint is unknown; nothing was run.
        """
        names = tuple(self._by_joint) if joints is None else tuple(joints)
        shares: dict[BusThread, list[str]] = {}
        for name in names:
            shares.setdefault(self._find(name)[1], []).append(name)
        return [
            thread.call(partial(_swapped, function, tuple(share)))
            for thread, share in shares.items()
        ]

    def _find(self, joint: str) -> tuple[ServoBus, BusThread]:
        try:
            return self._by_joint[joint]
        except KeyError:
            raise GoalError(
                f"no joint {joint!r} on any bus; there are {', '.join(self._by_joint)}"
            ) from None


def _swapped(
    function: Callable[[ServoBus, tuple[str, ...]], _T], joints: tuple[str, ...], bus: ServoBus
) -> _T:
    return function(bus, joints)
