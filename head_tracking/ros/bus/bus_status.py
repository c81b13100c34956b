"""The diagnostics of the servo bus."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from diagnostic_msgs.msg import DiagnosticStatus

from head_tracking.dynamixel import (
    BusSettings,
    BusStatistics,
    BusTiming,
    Health,
    ServoState,
    ServoStatistics,
    describe_errors,
)
from head_tracking.ros.kit.diagnostics import FAULT, FaultName, Level, status_message

_FRESH_CYCLES = 5.0
_FRESH_SECONDS = 0.2

_BAD = {Health.UNKNOWN: FaultName.NOT_FOUND, Health.LOST: FaultName.NO_ANSWER}


@dataclass(frozen=True, slots=True)
class BusStatus:
    """The status of a bus at one moment.

    Attributes:
        states: of the latest cycle, by joint.
        now: time on the clock of the stamps [ns].
    """

    port_name: str
    statistics: BusStatistics
    timing: BusTiming
    states: Mapping[str, ServoState]
    now: int = 0
    settings: BusSettings = field(default_factory=BusSettings)

    @property
    def faults(self) -> int:
        """Number of transactions without a valid reply, and of lost adapters."""
        failed = sum(servo.counters.failed for servo in self.statistics.servos)
        return failed + self.statistics.port_losses

    @property
    def in_short(self) -> str:
        """The status in a few words, such as "50 Hz"."""
        if not self.statistics.connected:
            return "unplugged"
        silent = sum(servo.health in _BAD for servo in self.statistics.servos)
        if silent:
            return f"{silent} of {len(self.statistics.servos)} servos silent"
        return f"{self.timing.reached_rate:.0f} Hz"


def combined(statuses: Sequence[BusStatus]) -> BusStatus:
    """Return the status of several buses as one, with the timing of the slowest."""
    first, *others = statuses
    if not others:
        return first
    slowest = min(statuses, key=lambda status: status.timing.reached_rate)
    return replace(
        first,
        port_name=", ".join(status.port_name for status in statuses),
        statistics=replace(
            slowest.statistics,
            connected=all(status.statistics.connected for status in statuses),
            port_losses=sum(status.statistics.port_losses for status in statuses),
            servos=tuple(servo for status in statuses for servo in status.statistics.servos),
        ),
        timing=slowest.timing,
        states={name: state for status in statuses for name, state in status.states.items()},
    )


def bus_diagnostics(status: BusStatus) -> list[DiagnosticStatus]:
    """Return an entry for the bus and one for each servo; OK only with recent data."""
    return [_bus(status), *(_servo(servo, status) for servo in status.statistics.servos)]


def _bus(status: BusStatus) -> DiagnosticStatus:
    timing, counted = status.timing, status.statistics
    level = Level.OK
    message = f"{timing.reached_rate:.1f} of {timing.update_rate:.1f} cycles per second"
    fault = "" if counted.connected else FaultName.NO_PORT
    if fault:
        level, message = Level.ERROR, "the port is missing; waiting for it"
    elif counted.adapter.advice:
        level, message = Level.WARN, counted.adapter.advice
    elif 0 < timing.reached_rate < 0.9 * timing.update_rate:
        level = Level.WARN
    return status_message(
        f"servo_bus: {status.port_name}",
        level,
        message,
        {
            "update rate wanted (Hz)": f"{timing.update_rate:.1f}",
            "update rate reached (Hz)": f"{timing.reached_rate:.1f}",
            "longest cycle (ms)": f"{1e3 * timing.longest_cycle:.1f}",
            "cycles": str(counted.cycles),
            "cycles left out": str(timing.missed),
            "commands refused": str(counted.refused_commands),
            "commands clamped": str(counted.clamped_commands),
            "adapter": str(counted.adapter),
            "times the port has gone": str(counted.port_losses),
            FAULT: fault or "none",
        },
        status.port_name,
    )


def _servo(servo: ServoStatistics, status: BusStatus) -> DiagnosticStatus:
    age = None if servo.last_stamp is None else (status.now - servo.last_stamp) * 1e-9
    level, message, fault = _verdict(servo, age, status)
    values = {
        "joint": servo.joint_name,
        "controller": servo.controller,
        "id": str(servo.id),
        "model": servo.model,
        "firmware": "unknown" if servo.firmware_version is None else str(servo.firmware_version),
        "state": servo.health.value,
        "torque": servo.torque,
        "errors": describe_errors(servo.errors),
        "age (s)": "never answered" if age is None else f"{age:.3f}",
        "replies": str(servo.counters.replies),
        "retries": str(servo.counters.retries),
        "timeouts": str(servo.counters.timeouts),
        "corrupt replies": str(servo.counters.corrupt),
        FAULT: fault or "none",
    }
    state = status.states.get(servo.joint_name)
    if state is not None and state.stamp == servo.last_stamp:
        values["position (rad)"] = f"{state.position:.4f}"
        values["velocity (rad/s)"] = f"{state.velocity:.3f}"
    for name, number, form in (
        ("load (share of full torque)", servo.load, ".2f"),
        ("voltage (V)", servo.voltage, ".1f"),
        ("temperature (degrees Celsius)", servo.temperature, ".0f"),
    ):
        if servo.health in (Health.PRESENT, Health.FAULTED):
            values[name] = f"{number:{form}}"
    name = f"servo_bus: {servo.joint_name}"
    if sum(other.joint_name == servo.joint_name for other in status.statistics.servos) > 1:
        name += f" (servo {servo.id})"
    return status_message(name, level, message, values, str(servo.id))


def _verdict(
    servo: ServoStatistics, age: float | None, status: BusStatus
) -> tuple[Level, str, str]:
    """Return level, message and fault of the most severe problem."""
    fresh = max(_FRESH_SECONDS, _FRESH_CYCLES / status.timing.update_rate)
    errors, health = describe_errors(servo.errors), servo.health
    if health is Health.FAULTED:
        return Level.ERROR, f"{health.value}: {errors}; call recover", errors
    if health in _BAD:
        return Level.ERROR, health.value, _BAD[health]
    if health is Health.STOPPED:
        return Level.WARN, health.value, ""
    if health is Health.STALE or age is None or age > fresh:
        return Level.STALE, Health.STALE.value, FaultName.LATE
    if servo.errors:
        return Level.ERROR, errors, errors
    if servo.temperature >= status.settings.temperature.error:
        text = f"{servo.temperature:.0f} degrees Celsius; {servo.torque}"
        return Level.ERROR, text, FaultName.HOT
    if servo.symptoms:
        serious = any(symptom.serious for symptom in servo.symptoms)
        level = Level.ERROR if serious else Level.WARN
        texts = [f"{symptom.value}: {text}" for symptom, text in servo.symptoms.items()]
        return level, "; ".join(texts), ", ".join(symptom.value for symptom in servo.symptoms)
    return Level.OK, servo.torque, ""
