"""The servos of one serial port, as what drives the joints of a loop."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress

from head_tracking.control.loop import ControlLoop
from head_tracking.dynamixel import (
    Buses,
    BusReading,
    BusStatistics,
    BusStoppedError,
    DynamixelError,
    DynamixelPort,
    Goal,
    JointConfiguration,
    ServoBus,
    Torque,
)

_PATIENCE = 2.0  # s


class DynamixelBackend:
    """A `JointBackend`: the servos of one serial port, in a thread that owns it.

    Args:
        port: the serial port.
        servos: of the joints.
        loop: run in each cycle between reading and writing, once `start` is called.
        rate: of the cycle [Hz].
        baud_rate: of the port [bit/s].
        reply_timeout: how long to wait for a servo's answer [s]; None: as long as answers take.
        on_failure: called with the error that has ended the thread.

    Raises:
        DynamixelError: the port cannot be opened, a servo does not answer or is another model.

    Attributes:
        period: of the cycle [s].
    """

    def __init__(
        self,
        port: str,
        servos: Sequence[JointConfiguration],
        loop: ControlLoop,
        rate: float,
        *,
        baud_rate: int,
        reply_timeout: float | None,
        on_failure: Callable[[BaseException], None],
    ) -> None:
        self.period = 1.0 / rate
        self._names = tuple(servo.joint_name for servo in servos)
        self._loop, self._port = loop, port
        self._measured = threading.Event()
        self._bus = ServoBus(
            DynamixelPort(port, baud_rate, reply_timeout=reply_timeout),
            servos,
            epoch=loop.owners.epoch,
        )
        self._bus.connect()
        self._buses = Buses([self._bus], rate, lambda *_: None, on_failure, self._update)

    def start(self) -> None:
        """Run the cycle from now on.

        Raises:
            BusStoppedError: the servos cannot be read.
        """
        self._buses.start()
        if not self._measured.wait(_PATIENCE):
            raise BusStoppedError(f"the servos on {self._port} answer, but cannot be read")

    def close(self) -> tuple[str, ...]:
        """Brake and relax the servos, close the port, and return joints without confirmation."""
        return self._buses.stop()

    def write(self, owner: str, goals: Mapping[str, Goal], epoch: int) -> None:
        """See `JointBackend`."""
        with suppress(DynamixelError):  # there was a stop, or a servo is silent: it shows
            self._bus.command(goals, clamp=True, epoch=epoch)

    def claim(self) -> None:
        """See `JointBackend`; there is no other servo bus."""

    def relax_now(self) -> Mapping[str, str]:
        """See `JointBackend`."""
        return self._buses.relax_at_once()

    @property
    def holds(self) -> bool:
        """Whether the torque of all servos is on."""
        return all(self._bus.torque(name) is Torque.ON for name in self._names)

    def switch_torque(self, on: bool, epoch: int | None = None) -> Future[None]:
        """Begin to switch the torque, and return when that is done, or why not.

        Args:
            on: on or off; off is done although there was a STOP.
            epoch: when it was asked for; None: now.
        """
        futures: list[Future[None]] = self._buses.call(
            None, lambda bus, joints: bus.switching_torque(joints, on), epoch, despite_stop=not on
        )
        return futures[0]

    def statistics(self) -> BusStatistics:
        """Return counters of the bus, and the latest measurements of each servo."""
        return self._bus.statistics()

    def _update(self, _: ServoBus, reading: BusReading) -> None:
        states = {name: reading.states[name] for name in self._names if name in reading.states}
        if len(states) == len(self._names):
            stamp = sum(state.stamp for state in states.values()) // len(states)
            self._loop.joints_read(stamp, states)
            self._loop.update(self._names)
            for controller in self._loop.controllers:
                if controller.failure is not None:
                    raise controller.failure
            self._measured.set()
