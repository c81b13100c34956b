"""How a bus deals with silence, faults and heat."""

from __future__ import annotations

from dataclasses import dataclass

from head_tracking.dynamixel.exceptions import ConfigurationError


@dataclass(frozen=True, slots=True)
class BusSettings:
    """Numbers that suit most robots.

    Attributes:
        retries: How often a failed read is repeated within the same cycle.
        lost_after: Failed cycles in a row after which a servo counts as lost.
        poll_interval: Time between two questions to a lost servo, s.
        reconnect_interval: Time between two looks for an adapter that has gone, s.
        command_timeout: Time after its last command at which a joint that is still under way holds
            where it is, s; 0: it goes on to its goal.
        watchdog: Time without any packet after which servos of the X series stop by themselves, s;
            0: never.
        warm: Temperature from which on a servo is worth a warning, degrees Celsius.
        hot: Temperature from which on it is an error.
        rest: Temperature from which on the joint is relaxed until its servo is no longer warm.

    Raises:
        ConfigurationError: A number makes no sense.
    """

    retries: int = 1
    lost_after: int = 5
    poll_interval: float = 0.06
    reconnect_interval: float = 0.2
    command_timeout: float = 0.0
    watchdog: float = 1.0
    warm: float = 60.0
    hot: float = 65.0
    rest: float = 68.0

    def __post_init__(self) -> None:
        allowed = (
            ("retries", self.retries >= 0, "at least 0"),
            ("lost_after", self.lost_after >= 1, "at least 1"),
            ("poll_interval", self.poll_interval > 0.0, "seconds above 0"),
            ("reconnect_interval", self.reconnect_interval > 0.0, "seconds above 0"),
            ("command_timeout", self.command_timeout >= 0.0, "0 or seconds above 0"),
            ("watchdog", 0.0 <= self.watchdog <= 2.5, "0 to 2.5 seconds"),
            ("hot", self.warm <= self.hot, f"at least warm, {self.warm} degrees"),
            ("rest", self.hot <= self.rest, f"at least hot, {self.hot} degrees"),
        )
        for name, possible, what in allowed:
            if not possible:
                raise ConfigurationError(
                    f"{name} {getattr(self, name)} is not possible; allowed are {what}"
                )
