"""A driver's port on a simulated bus in simulated time: no pty, no thread, no waiting."""

from __future__ import annotations

import io
from collections.abc import Iterable
from typing import Any

from head_tracking.dynamixel import (
    Adapter,
    DynamixelPort,
    Epoch,
    JointConfiguration,
    ServoBus,
    ServoModel,
)
from head_tracking.simulation import SimulatedBus, SimulatedClock, SimulatedLine, SimulatedServo


def as_device(line: SimulatedLine) -> Any:
    """Return a line that takes the place of an open serial device."""
    line.adapter, line.close = Adapter(), lambda: None  # type: ignore[attr-defined]
    return line


class Keyboard(io.StringIO):
    """A terminal with prepared answers."""

    def isatty(self) -> bool:
        return True


def joint_of(
    servo_id: int, model: ServoModel, low: int = 0, high: int | None = None
) -> JointConfiguration:
    """Return a joint with this servo and these limits, in ticks; by default its whole range."""
    high = model.ticks - 1 if high is None else high
    return JointConfiguration(
        f"j{servo_id}", servo_id, model.center, low, high, controller=f"c{servo_id}", model=model
    )


class Bench:
    """Servos and the port that they are on.

    Args:
        servos: the servos, or a bus.
        baud_rate: of line and port [bit/s].
        latency: of the adapter [s].
    """

    def __init__(
        self,
        servos: SimulatedBus | Iterable[SimulatedServo],
        baud_rate: int = 1_000_000,
        latency: float = 0.0,
    ) -> None:
        self.bus = servos if isinstance(servos, SimulatedBus) else SimulatedBus(servos)
        self.clock = SimulatedClock(1_000_000_000)
        self.line = SimulatedLine(self.bus, self.clock, baud_rate, latency=latency)
        self.port = DynamixelPort(
            "simulated",
            baud_rate,
            open_device=lambda *_: as_device(self.line),
            clock=self.clock,
        )

    def servo_bus(
        self, joints: Iterable[JointConfiguration], epoch: Epoch | None = None
    ) -> ServoBus:
        return ServoBus(
            self.port,
            joints,
            self.now,
            monotonic=self.now,
            pause=self.pass_time,
            epoch=epoch,
        )

    def now(self) -> int:
        return self.clock.now

    def pass_time(self, seconds: float) -> None:
        self.clock.now += round(seconds * 1e9)

    def turn_by_hand(self, servo_id: int, tick: float) -> None:
        """Lead a servo to a tick, and let it come to rest there."""
        self.bus.advance(self.clock.now)
        self.bus[servo_id].lead(tick, 0.5, 2.0)
        self.pass_time(2.0)
        self.bus.advance(self.clock.now)
