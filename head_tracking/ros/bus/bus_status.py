"""The diagnostics of the servo bus."""

from __future__ import annotations

from collections import Counter

from diagnostic_msgs.msg import DiagnosticStatus

from head_tracking.dynamixel import (
    BusSettings,
    BusStatistics,
    BusTiming,
    Health,
    ServoStatistics,
    describe_errors,
)
from head_tracking.ros.kit.diagnostics import FAULT, FaultName, Level, status_message

_FRESH_CYCLES = 5.0
_FRESH_SECONDS = 0.2

_BAD = {Health.UNKNOWN: FaultName.NOT_FOUND, Health.LOST: FaultName.NO_ANSWER}


def bus_diagnostics(
    bus: BusStatistics, timing: BusTiming, settings: BusSettings, now: int
) -> list[DiagnosticStatus]:
    """Return an entry for the bus and one for each servo; OK only with recent data.

    `now` is on the clock of the stamps [ns].
    """
    fresh = max(_FRESH_SECONDS, _FRESH_CYCLES / timing.update_rate)
    pairs = Counter(servo.joint_name for servo in bus.servos)
    entries = [_bus(bus, timing)]
    for servo in bus.servos:
        name = f"servo_bus: {servo.joint_name}"
        if pairs[servo.joint_name] > 1:
            name += f" (servo {servo.id})"
        age = None if servo.last_stamp is None else (now - servo.last_stamp) * 1e-9
        is_late = age is None or age > fresh
        level, message, fault = _verdict(servo, is_late, settings.temperature.error)
        values = _values(servo, age) | {FAULT: fault or "none"}
        entries.append(status_message(name, level, message, values, str(servo.id)))
    return entries


def _bus(bus: BusStatistics, timing: BusTiming) -> DiagnosticStatus:
    level = Level.OK
    message = f"{timing.reached_rate:.1f} of {timing.update_rate:.1f} cycles per second"
    fault = "" if bus.connected else FaultName.NO_PORT
    if fault:
        level, message = Level.ERROR, "the port is missing; waiting for it"
    elif bus.adapter.advice:
        level, message = Level.WARN, bus.adapter.advice
    elif 0 < timing.reached_rate < 0.9 * timing.update_rate:
        level = Level.WARN
    return status_message(
        f"servo_bus: {bus.port_name}",
        level,
        message,
        {
            "update rate wanted (Hz)": f"{timing.update_rate:.1f}",
            "update rate reached (Hz)": f"{timing.reached_rate:.1f}",
            "longest cycle (ms)": f"{1e3 * timing.longest_cycle:.1f}",
            "cycles": str(bus.cycles),
            "cycles left out": str(timing.missed),
            "commands refused": str(bus.refused_commands),
            "commands clamped": str(bus.clamped_commands),
            "adapter": str(bus.adapter),
            "times the port has gone": str(bus.port_losses),
            FAULT: fault or "none",
        },
        bus.port_name,
    )


def _values(servo: ServoStatistics, age: float | None) -> dict[str, str]:
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
    }
    if servo.health in (Health.PRESENT, Health.FAULTED):
        values["position (rad)"] = f"{servo.position:.4f}"
        values["velocity (rad/s)"] = f"{servo.velocity:.3f}"
        values["load (share of full torque)"] = f"{servo.load:.2f}"
        values["voltage (V)"] = f"{servo.voltage:.1f}"
        values["temperature (degrees Celsius)"] = f"{servo.temperature:.0f}"
    return values


def _verdict(servo: ServoStatistics, is_late: bool, too_hot: float) -> tuple[Level, str, str]:
    """Return level, message and fault of the most severe problem."""
    errors, health = describe_errors(servo.errors), servo.health
    if health is Health.FAULTED:
        return Level.ERROR, f"{health.value}: {errors}; call recover", errors
    if health in _BAD:
        return Level.ERROR, health.value, _BAD[health]
    if health is Health.STOPPED:
        return Level.WARN, health.value, ""
    if health is Health.STALE or is_late:
        return Level.STALE, Health.STALE.value, FaultName.LATE
    if servo.errors:
        return Level.ERROR, errors, errors
    if servo.temperature >= too_hot:
        text = f"{servo.temperature:.0f} degrees Celsius; {servo.torque}"
        return Level.ERROR, text, FaultName.HOT
    if servo.symptoms:
        serious = any(symptom.serious for symptom in servo.symptoms)
        level = Level.ERROR if serious else Level.WARN
        texts = [f"{symptom.value}: {text}" for symptom, text in servo.symptoms.items()]
        return level, "; ".join(texts), ", ".join(symptom.value for symptom in servo.symptoms)
    return Level.OK, servo.torque, ""
