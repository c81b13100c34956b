"""doctor looks at a port and its servos. It pings and reads; it writes nothing to a servo."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Final

from head_tracking.dynamixel import (
    CommunicationError,
    ConfigurationError,
    CorruptReplyError,
    DynamixelPort,
    JointConfiguration,
    PortBusyError,
    PortError,
    PortLostError,
    PortMissingError,
    PortPermissionError,
    ReplyTimeoutError,
    Servo,
    ServoCalibration,
    ServoError,
    ServoIdentity,
    ServoModeError,
    WrongModelError,
    describe_errors,
)
from head_tracking.dynamixel.diagnosis import lowest_supply, swapped, warm_from
from head_tracking.dynamixel.servo import run
from head_tracking.tools.doctor.configuration import ConfiguredBus
from head_tracking.tools.doctor.findings import Finding, Level
from head_tracking.tools.servo.bench import patient_port
from head_tracking.tools.servo.looks import USUAL_BAUD_RATES

_READINGS: Final = 50
_FEW: Final = 0.05  # of the readings that may fail
_SPOILT: Final = (0, 255)  # firmware versions of a servo whose update was broken off


@dataclass(slots=True)
class _Found:
    """What was read of a servo.

    Attributes:
        joint: The joint that it drives.
        servo: It.
        identity: What it says that it is; None if that does not do.
        voltage: Supply, V; with the servo's own limits.
        temperature: °C.
        errors: What it complains of.
    """

    joint: JointConfiguration
    servo: Servo
    identity: ServoIdentity | None = None
    voltage: tuple[float, float, float] = (0.0, 0.0, 0.0)
    temperature: float = 0.0
    errors: str = "none"
    problems: dict[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """For messages."""
        return f"servo {self.servo.id} ({self.joint.joint_name})"


def owner(port_name: str, proc: Path = Path("/proc")) -> str:
    """Who has a device open, as far as this user may know; empty if nobody is seen."""
    device = os.path.realpath(port_name)
    for process in proc.glob("[0-9]*"):
        if process.name == str(os.getpid()):
            continue
        with suppress(OSError):
            if any(os.path.realpath(link) == device for link in (process / "fd").iterdir()):
                words = (process / "cmdline").read_bytes().split(b"\0")
                return f"process {process.name}: {b' '.join(words).decode(errors='replace')[:80]}"
    return ""


def look_at_bus(
    bus: ConfiguredBus,
    make_port: Callable[[str, int], DynamixelPort] = patient_port,
    proc: Path = Path("/proc"),
) -> Iterator[Finding]:
    """Look at a port and all that is on it. A port that another program owns is left alone."""
    check = "port"
    try:
        port = make_port(bus.port_name, bus.baud_rate)
        port.open()
    except PortBusyError:
        who = owner(bus.port_name, proc) or "another program, of another user"
        yield Finding(
            check,
            Level.AMBER,
            f"{bus.port_name} belongs to {who}; it was left alone",
            "stop that program to look at the servos themselves; what a servo_bus says of them "
            "on /diagnostics follows",
        )
        return
    except PortPermissionError as error:
        yield Finding("rights", Level.RED, str(error), "sudo usermod -a -G dialout $USER, then "
                      "log out and in; or ros2 run head_tracking head_setup udev")  # fmt: skip
        return
    except PortMissingError as error:
        cure = "plug the adapter in, or name its port: --port, or port_name in a parameter file"
        yield Finding(check, Level.RED, str(error), cure)
        return
    except (PortError, ConfigurationError) as error:
        cure = "choose another port or baud rate (--port, --baud)"
        yield Finding(check, Level.RED, str(error), cure)
        return
    with closing(port):
        yield Finding(check, Level.GREEN, f"{bus.port_name} at {bus.baud_rate} baud, ours alone")
        yield Finding("rights", Level.GREEN, "it may be opened")
        try:
            found = yield from _servos(bus, port, make_port)
            if found:
                yield from _all(bus, port, found)
        except PortLostError as error:
            yield Finding(check, Level.RED, str(error), "plug the adapter in again")


def _all(bus: ConfiguredBus, port: DynamixelPort, found: list[_Found]) -> Iterator[Finding]:
    yield _of("models", found, "as configured", "correct motor.model, or the id")
    yield _settings(bus, found)
    yield _firmware(found)
    yield _voltage(found)
    yield _temperature(bus, found)
    yield _errors(found)
    yield from _line(bus, port, [each for each in found if each.identity is not None])


def _servos(
    bus: ConfiguredBus, port: DynamixelPort, make_port: Callable[[str, int], DynamixelPort]
) -> Generator[Finding, None, list[_Found]]:
    """Whether all servos answer, each alone; returns what was read of those that do."""
    found: list[_Found] = []
    silent: list[_Found] = []
    twins: list[str] = []
    for joint in bus.joints:
        for calibration in joint.calibrations:
            each = _Found(joint, _servo(port, calibration))
            try:
                each.servo.ping(3)
                _read(each)
            except ReplyTimeoutError:
                silent.append(each)
                continue
            except CorruptReplyError as error:
                twins.append(f"{each.name}: {error}")
                continue
            except CommunicationError as error:
                each.problems["settings"] = str(error)
            if port.surplus[calibration.id]:
                twins.append(f"{each.name} answers more than once")
            found.append(each)
    if silent:
        yield _silent(bus, silent, port, make_port)
    else:
        ids = ", ".join(str(each.servo.id) for each in found) or "none alone"
        yield Finding("baud rate", Level.GREEN, f"servos answer at {port.baud_rate}: ids {ids}")
    if twins:
        yield Finding(
            "ids",
            Level.RED,
            f"two servos have one id, or something disturbs the line: {'; '.join(twins)}",
            "connect one servo alone and give it another id: servo set-id; check the cables",
        )
    elif found:
        yield Finding("ids", Level.GREEN, "each is there once")
    return found


def _servo(port: DynamixelPort, calibration: ServoCalibration) -> Servo:
    return Servo(port, calibration.id, calibration.model, calibration)


def _read(each: _Found) -> None:
    servo = each.servo
    try:
        each.identity = run(servo.identify(keep_torque=True))
    except WrongModelError as error:
        each.problems["models"] = str(error)
        return
    except (ServoModeError, ServoError, ConfigurationError) as error:
        each.problems["settings"] = str(error)
        return
    feedback = servo.read_feedback(3)
    limits = [servo.get(name) * 0.1 for name in ("Min Voltage Limit", "Max Voltage Limit")]
    each.voltage = (feedback.voltage * 0.1, limits[0], limits[1])
    each.temperature = float(feedback.temperature)
    each.errors = describe_errors(servo.state_of(feedback.error))
    if each.identity.faulted:
        each.problems["errors"] = f"{each.name} has shut itself down ({each.errors})"
    elif each.errors != "none":
        each.problems["errors"] = f"{each.name} says: {each.errors}"


def _silent(
    bus: ConfiguredBus,
    silent: list[_Found],
    port: DynamixelPort,
    make_port: Callable[[str, int], DynamixelPort],
) -> Finding:
    names = ", ".join(each.name for each in silent)
    port.close()  # only one may have it open
    try:
        for rate in USUAL_BAUD_RATES:
            if rate == bus.baud_rate:
                continue
            there = _answers_at(rate, bus, silent, make_port)
            if there:
                return Finding(
                    "baud rate",
                    Level.RED,
                    f"no answer from {names} at {bus.baud_rate} baud; servo {there[0]} answers at "
                    f"{rate}",
                    f"set baud_rate: {rate}, or `servo --baud {rate} set-baud {there[0]} "
                    f"{bus.baud_rate}`; all on a port need the same",
                )
    finally:
        port.open()
    return Finding(
        "baud rate",
        Level.RED,
        f"no answer from {names}, at {bus.baud_rate} baud and the usual others",
        "check the servos' power, and that the cable runs on to each of them; `servo scan` looks "
        "for other ids",
    )


def _answers_at(
    rate: int,
    bus: ConfiguredBus,
    silent: list[_Found],
    make_port: Callable[[str, int], DynamixelPort],
) -> list[int]:
    with suppress(PortError, ConfigurationError), closing(make_port(bus.port_name, rate)) as port:
        port.open()
        for each in silent:
            with suppress(CommunicationError):
                _servo(port, each.servo.calibration).ping(2)
                return [each.servo.id]
    return []


def _of(check: str, found: list[_Found], fine: str, cure: str) -> Finding:
    problems = [each.problems[check] for each in found if check in each.problems]
    if problems:
        return Finding(check, Level.RED, "; ".join(problems), cure)
    return Finding(check, Level.GREEN, fine)


def _settings(bus: ConfiguredBus, found: list[_Found]) -> Finding:
    """Modes and angle limits; and whether they are those of another joint's servo."""
    names = {each.servo.id: each.name for each in found}
    exchanged = [
        f"{names[servo_id]} has the angle limits meant for servo {other.id}"
        for servo_id, other in swapped(each.servo for each in found).items()
    ]
    if exchanged:
        return Finding(
            "settings",
            Level.RED,
            f"{'; '.join(exchanged)}: they may be swapped",
            "see which one moves: `servo monitor`, and turn the relaxed head by hand; swap the ids "
            "in the configuration, or servo set-id",
        )
    cure = "follow what it says; docs/servo.md tells about `servo set`"
    return _of("settings", found, "position mode; angle limits fit", cure)


def _firmware(found: list[_Found]) -> Finding:
    known = [(each, each.identity) for each in found if each.identity is not None]
    versions = ", ".join(f"{each.servo.id}: {who.firmware_version}" for each, who in known)
    spoilt = [each.name for each, who in known if who.firmware_version in _SPOILT]
    if spoilt:
        return Finding(
            "firmware",
            Level.RED,
            f"{', '.join(spoilt)}: version {versions}: an update was probably broken off",
            "recover it with ROBOTIS' Dynamixel Wizard",
        )
    unwatched = [
        each.name
        for each, who in known
        if each.servo.model.watchdog is not None
        and who.firmware_version < each.servo.model.watchdog
    ]
    if unwatched:
        return Finding(
            "firmware",
            Level.AMBER,
            f"{', '.join(unwatched)} has no Bus Watchdog: should the program die, it goes on to "
            "its goal",
            "update it with Dynamixel Wizard, if it matters",
        )
    return Finding("firmware", Level.GREEN, versions or "nobody tells")


def _voltage(found: list[_Found]) -> Finding:
    told, level = [], Level.GREEN
    for each in found:
        volts, lowest, highest = each.voltage
        if each.identity is None:
            continue
        told.append(f"{each.servo.id}: {volts:.1f} V")
        if not lowest <= volts <= highest:
            told[-1] += f" (its own limits: {lowest:.1f} to {highest:.1f} V)"
            level = Level.RED
        elif volts < lowest_supply(each.servo.model, lowest, 0.9):  # nothing moves
            told[-1] += f" (made for {each.servo.model.nominal_voltage:.1f} V)"
            level = max(level, Level.AMBER)
    cure = "" if level is Level.GREEN else (
        "charge the battery, or take a supply of the right voltage and enough current "
        "(docs/hardware.md), and short thick cables"
    )  # fmt: skip
    return Finding("voltage", level, ", ".join(told) or "nobody tells", cure)


def _temperature(bus: ConfiguredBus, found: list[_Found]) -> Finding:
    told, level = [], Level.GREEN
    for each in found:
        if each.identity is None:
            continue
        limit = each.identity.temperature_limit
        told.append(f"{each.servo.id}: {each.temperature:.0f} °C")
        if each.temperature >= min(bus.settings.hot, limit):
            told[-1] += f" (its limit: {limit:.0f} °C)"
            level = Level.RED
        elif each.temperature >= warm_from(bus.settings.warm, limit):
            level = max(level, Level.AMBER)
    cure = "" if level is Level.GREEN else (
        "let it cool; find out what it works against: balance the head, free the cables"
    )  # fmt: skip
    return Finding("temperature", level, ", ".join(told) or "nobody tells", cure)


def _errors(found: list[_Found]) -> Finding:
    cure = "find out why, let it cool, then call recover (or cycle its power)"
    return _of("errors", found, "no servo complains", cure)


def _line(bus: ConfiguredBus, port: DynamixelPort, found: list[_Found]) -> Iterator[Finding]:
    """How well and how fast the servos can be read, as the bus will do it; and the adapter."""
    failed, times = 0, []
    for _ in range(_READINGS):
        begin = port.clock()
        before = failed
        for each in found:
            try:
                each.servo.read_feedback()
            except CommunicationError:
                failed += 1
        if failed == before:
            times.append(port.clock() - begin)
    total = _READINGS * len(found)
    if not total:
        return
    cycle = median(times) if times else float("inf")
    period = 1.0 / bus.update_rate
    advice, adapter = port.adapter.advice, str(port.adapter)
    if advice and cycle > 0.8 * period:
        yield Finding(
            "latency timer",
            Level.RED,
            f"{adapter}: reading all servos takes {1e3 * cycle:.0f} of {1e3 * period:.0f} ms",
            f"ros2 run head_tracking head_setup udev, and plug it in again; {advice}",
        )
    elif advice:
        yield Finding("latency timer", Level.AMBER, adapter, advice)
    else:
        yield Finding("latency timer", Level.GREEN, adapter)
    text = (
        f"{failed} of {total} readings failed; all servos in {1e3 * cycle:.1f} of "
        f"{1e3 * period:.0f} ms"
    )
    if failed > _FEW * total:
        cure = "check plugs, cable lengths, ground and supply; two masters on one line; servo ids"
        yield Finding("line", Level.RED, text, cure)
    elif cycle > 0.8 * period and not advice:
        cure = "raise the baud rate (servo set-baud), set return_delay 0, or lower update_rate"
        yield Finding("line", Level.RED, text, cure)
    elif failed:
        yield Finding("line", Level.AMBER, text, "check plugs and cables, and the supply's ground")
    else:
        yield Finding("line", Level.GREEN, text)
