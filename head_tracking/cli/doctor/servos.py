"""Checks of doctor: port, adapter and servos. They ping and read only."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, suppress
from statistics import median
from typing import Final

from head_tracking.cli.doctor.findings import Finding, Grade
from head_tracking.cli.servo.session import USUAL_BAUD_RATES
from head_tracking.configuration import ConfiguredBus
from head_tracking.dynamixel import (
    CommunicationError,
    ConfigurationError,
    DynamixelPort,
    PortBusyError,
    PortError,
    PortLostError,
    ReplyTimeoutError,
    ServoError,
    Symptom,
    describe_errors,
)
from head_tracking.dynamixel.configuration import TemperatureParameters
from head_tracking.dynamixel.diagnosis import conditions, swapped
from head_tracking.dynamixel.exceptions import advice
from head_tracking.dynamixel.joint import BusJoint, bus_joints
from head_tracking.dynamixel.servo import Servo, run

_READINGS: Final = 50
_FEW_FAILURES: Final = 0.05  # share of failed readings that is amber
_INTERRUPTED_UPDATE: Final = (0, 255)  # firmware versions


def check_bus(
    bus: ConfiguredBus, make_port: Callable[[str, int], DynamixelPort]
) -> Iterator[Finding]:
    """Check a port, its adapter and its servos; a port that is in use is not opened."""
    try:
        port = make_port(bus.port_name, bus.baud_rate)
        port.open()
    except PortBusyError as error:
        yield Finding("port", Grade.AMBER, f"{error}. It was not checked")
        return
    except (PortError, ConfigurationError) as error:
        yield Finding("port", Grade.RED, str(error))
        return
    silent: list[Servo] = []
    with closing(port):
        yield Finding("port", Grade.GREEN, f"{bus.port_name} at {bus.baud_rate} baud")
        try:
            joints = bus_joints(bus.joints, port).values()
            servos = [servo for joint in joints for servo in joint.servos]
            for servo in servos:
                yield from _check_servo(servo, port, bus.temperature)
            yield from _check_limits(joints, servos)
            yield from _check_line(bus, port, [each for each in servos if each.identity])
            silent = [each for each in servos if not each.counters.replies]
        except PortLostError as error:
            yield Finding("port", Grade.RED, str(error))
    for rate in USUAL_BAUD_RATES if silent else ():
        if rate != bus.baud_rate:
            with suppress(PortError, ConfigurationError):  # the adapter does not support this rate
                yield from _check_other_rate(bus, make_port(bus.port_name, rate), silent)


def _check_other_rate(
    bus: ConfiguredBus, port: DynamixelPort, servos: Sequence[Servo]
) -> Iterator[Finding]:
    """Check whether silent servos answer at the baud rate of another port."""
    port.open()
    with closing(port):
        for servo in servos:
            with suppress(CommunicationError):
                port.ping(servo.id, servo.model.protocol)
                command = port.servo_command(f"set-baud {servo.id} {bus.baud_rate}")
                text = (
                    f"{servo.calibration.joint_name}: answers at {port.baud_rate} baud, not at "
                    f"{bus.baud_rate}: set baud_rate, or `{command}`"
                )
                yield Finding(f"servo {servo.id}", Grade.RED, text)


def _check_servo(
    servo: Servo, port: DynamixelPort, limits: TemperatureParameters
) -> Iterator[Finding]:
    name, model = f"servo {servo.id}", servo.model
    joint = servo.calibration.joint_name
    try:
        servo.ping(3)
        identity = run(servo.identify(keep_torque=True))
        servo.read_feedback(3)
        errors = servo.read_errors()
    except ReplyTimeoutError:
        text = (
            f"{joint}: no answer at {port.baud_rate} baud. Check its power and cable; "
            f"`{port.servo_command('scan')}` finds other ids and baud rates"
        )
        yield Finding(name, Grade.RED, text)
        return
    except (CommunicationError, ServoError, ConfigurationError) as error:
        yield Finding(name, Grade.RED, f"{joint}: {error}")
        return
    problems: list[tuple[Grade, str]] = []
    if port.surplus[servo.id]:
        problems.append((Grade.RED, advice(servo.id)))
    if errors or servo.faulted:
        state = "has shut itself down" if servo.faulted else "reports"
        text = f"it {state}: {describe_errors(errors)}; let it cool, call `recover` or cycle its "
        problems.append((Grade.RED, f"{text}power"))
    if identity.firmware_version in _INTERRUPTED_UPDATE:
        text = f"firmware {identity.firmware_version}: an update was interrupted; recover it with "
        problems.append((Grade.RED, f"{text}Dynamixel Wizard"))
    volts, celsius = servo.voltage, servo.temperature
    is_red = {
        Symptom.SUPPLY: volts < identity.lowest_voltage,
        Symptom.WARM: celsius >= min(limits.error, identity.temperature_limit),
    }
    for symptom, text in conditions(servo, limits.warn, 0.9).items():  # 0.9: nothing moves
        problems.append((Grade.RED if is_red[symptom] else Grade.AMBER, text))
    level = max((level for level, _ in problems), default=Grade.GREEN)
    facts = f"{joint}: {model.name}, firmware {identity.firmware_version}, {volts:.1f} V, "
    yield Finding(name, level, "; ".join([f"{facts}{celsius:.0f} °C", *(t for _, t in problems)]))


def _check_limits(joints: Iterable[BusJoint], servos: Sequence[Servo]) -> Iterator[Finding]:
    for joint in joints:
        try:
            joint.require_range()
        except ConfigurationError as error:
            yield Finding(f"servo {joint.servos[0].id}", Grade.RED, str(error))
    for servo_id, other in swapped(servos).items():
        text = f"its memory has the angle limits of servo {other.id}; the two ids may be swapped"
        yield Finding(f"servo {servo_id}", Grade.RED, text)


def _check_line(
    bus: ConfiguredBus, port: DynamixelPort, servos: Sequence[Servo]
) -> Iterator[Finding]:
    """Check failures and time of reading all servos."""
    failed, times = 0, []
    for _ in range(_READINGS if servos else 0):
        begin, before = port.clock(), failed
        for servo in servos:
            try:
                servo.read_feedback()
            except CommunicationError:
                failed += 1
        if failed == before:
            times.append(port.clock() - begin)
    cycle, period = median(times) if times else float("inf"), 1.0 / bus.update_rate
    slow = bool(servos) and cycle > 0.8 * period
    adapter, advice = str(port.adapter), port.adapter.advice
    level = Grade.GREEN if not advice else Grade.RED if slow else Grade.AMBER
    yield Finding("adapter", level, f"{adapter}; {advice}" if advice else adapter)
    if not servos:
        return
    total = _READINGS * len(servos)
    text = f"{failed} of {total} readings failed; a cycle takes {1e3 * cycle:.1f} of "
    text += f"{1e3 * period:.0f} ms"
    text += ": raise the baud rate, or lower return_delay, update_rate" if slow else ""
    text += "; check plugs, cables, ground, supply, and for a second master" if failed else ""
    if slow or failed > _FEW_FAILURES * total:
        yield Finding("line", Grade.RED, text)
    else:
        yield Finding("line", Grade.AMBER if failed else Grade.GREEN, text)
