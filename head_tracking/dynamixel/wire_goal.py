"""The goal of a joint, as it goes over the wire each cycle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from head_tracking.dynamixel.mount import ServoMount
from head_tracking.dynamixel.servo_link import SLOWEST


@dataclass(slots=True)
class WireGoal:
    """A tick for each servo and a speed.

    Attributes:
        ticks: Goal position of each servo.
        speed: rad/s; None stands for the joint's own, 0 for the slowest.
        since: When it was commanded, monotonic ns; None for a goal that is held.
    """

    ticks: tuple[int, ...]
    speed: float | None
    since: int | None
    _shares: tuple[bytes, ...] = ()
    _encoded: float = -1.0

    def shares(
        self, mounts: Sequence[ServoMount], default_speed: float, speed_limit: float
    ) -> tuple[bytes, ...]:
        """Return the bytes of goal position and speed for each servo, made anew when they change.

        Args:
            mounts: The servos.
            default_speed: The joint's own speed, rad/s.
            speed_limit: The joint's highest speed, rad/s.
        """
        speed = default_speed if self.speed is None else self.speed
        if self._encoded != speed:
            self._shares = tuple(
                mount.model.encode_goal(
                    ticks, mount.speed_ticks(speed, speed_limit) if speed > 0.0 else SLOWEST
                )
                for mount, ticks in zip(mounts, self.ticks, strict=True)
            )
            self._encoded = speed
        return self._shares
