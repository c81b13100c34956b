"""What can be configured of the servo bus besides its joints."""

from __future__ import annotations

from dataclasses import dataclass

from head_tracking.dynamixel import BusSettings, EepromSettings
from head_tracking.parameters import parameter


@dataclass(frozen=True, slots=True)
class ServoBusParameters:
    """The port and who is on it."""

    port_name: str = parameter("/dev/ttyUSB0", "Serial port of the bus.", fixed=True)
    baud_rate: int = parameter(
        1_000_000, "Speed of the bus.", unit="bit/s", minimum=9600, maximum=4_500_000, fixed=True
    )
    update_rate: float = parameter(
        50.0, "Bus cycles per second.", unit="Hz", minimum=1.0, maximum=1000.0, fixed=True
    )
    diagnostics_rate: float = parameter(
        1.0, "Diagnostics per second.", unit="Hz", minimum=0.1, maximum=50.0, fixed=True
    )
    reply_timeout: float = parameter(
        0.0,
        "How long to wait for a servo's answer, besides its time on the wire; 0: as long as "
        "answers take on this port, and a margin.",
        unit="s",
        minimum=0.0,
        maximum=1.0,
        fixed=True,
    )
    allow_missing: bool = parameter(
        False, "Start without the servos that do not answer, and look for them.", fixed=True
    )
    command_timeout: float = parameter(
        0.0,
        "A joint that is under way holds where it is this long after its last command; 0: never.",
        unit="s",
        minimum=0.0,
        maximum=60.0,
        fixed=True,
    )
    bus_watchdog: float = parameter(
        1.0,
        "Servos of the X series stop by themselves after this time without a packet; 0: never.",
        unit="s",
        minimum=0.0,
        maximum=2.5,
        fixed=True,
    )
    dynamixels: tuple[str, ...] = parameter(
        ("head_pan", "head_tilt"), "The servos; X is described by X_controller.*.", fixed=True
    )


@dataclass(frozen=True, slots=True)
class TemperatureParameters:
    """When a servo is too warm; the factory's own limit is 65 to 80 degrees."""

    warn: float = parameter(
        60.0, "Worth a warning.", unit="degrees Celsius", minimum=0.0, maximum=100.0, fixed=True
    )
    error: float = parameter(
        65.0, "Worth an error.", unit="degrees Celsius", minimum=0.0, maximum=100.0, fixed=True
    )
    rest: float = parameter(
        68.0,
        "The joint is relaxed, until it is below the warning.",
        unit="degrees Celsius",
        minimum=0.0,
        maximum=100.0,
        fixed=True,
    )


@dataclass(frozen=True, slots=True)
class EepromParameters:
    """What the service write_eeprom puts into the memory of the servos."""

    return_delay: float = parameter(
        0.0, "Time before a servo answers.", unit="microseconds", minimum=0.0, maximum=508.0
    )
    angle_limits: bool = parameter(True, "The servo itself refuses goals beyond min and max.")
    shutdown: tuple[str, ...] = parameter(
        (),
        "Errors upon which a servo switches itself off, such as overload and overheating; none: "
        "those that it has.",
    )
    status_return_level: int = parameter(
        2, "What a servo answers: 1 pings and reads, 2 everything.", minimum=1, maximum=2
    )

    @property
    def settings(self) -> EepromSettings:
        """The same for the servo bus."""
        return EepromSettings(
            self.return_delay, self.angle_limits, self.shutdown or None, self.status_return_level
        )


def bus_settings(p: ServoBusParameters, temperature: TemperatureParameters) -> BusSettings:
    """How the bus deals with silence, faults and heat.

    Raises:
        ConfigurationError: the temperatures do not rise.
    """
    return BusSettings(
        command_timeout=p.command_timeout,
        watchdog=p.bus_watchdog,
        warm=temperature.warn,
        hot=temperature.error,
        rest=temperature.rest,
    )
