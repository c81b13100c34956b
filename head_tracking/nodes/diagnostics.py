"""What the servo bus says on /diagnostics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from head_tracking.dynamixel import (
    BusStatistics,
    BusTiming,
    ServoState,
    ServoStatistics,
    describe_errors,
)


@dataclass(frozen=True, slots=True)
class BusStatus:
    """What there is to know about a bus at one moment.

    Attributes:
        port_name: the port.
        statistics: counters.
        timing: how the cycle keeps up.
        states: what the last cycle read, by joint.
    """

    port_name: str
    statistics: BusStatistics
    timing: BusTiming
    states: Mapping[str, ServoState]

    @property
    def faults(self) -> int:
        """Transactions that were answered badly or not at all."""
        return sum(servo.timeouts + servo.corrupt for servo in self.statistics.servos)


def bus_diagnostics(status: BusStatus) -> DiagnosticArray:
    """One entry for the bus and one for every servo; OK only with a fresh state."""
    return DiagnosticArray(
        status=[
            _bus(status),
            *(
                _servo(servo, status.states.get(servo.joint_name))
                for servo in status.statistics.servos
            ),
        ]
    )


def _bus(status: BusStatus) -> DiagnosticStatus:
    timing = status.timing
    slow = 0 < timing.reached_rate < 0.9 * timing.update_rate
    return _entry(
        f"servo_bus: {status.port_name}",
        DiagnosticStatus.WARN if slow else DiagnosticStatus.OK,
        f"{timing.reached_rate:.1f} of {timing.update_rate:.1f} cycles per second",
        {
            "update rate wanted (Hz)": f"{timing.update_rate:.1f}",
            "update rate reached (Hz)": f"{timing.reached_rate:.1f}",
            "longest cycle (ms)": f"{1e3 * timing.longest_cycle:.1f}",
            "cycles": str(status.statistics.cycles),
            "cycles left out": str(timing.missed),
            "commands refused": str(status.statistics.refused_commands),
            "commands clamped": str(status.statistics.clamped_commands),
        },
        status.port_name,
    )


def _servo(servo: ServoStatistics, state: ServoState | None) -> DiagnosticStatus:
    name = f"servo_bus: {servo.joint_name}"
    counters = {
        "id": str(servo.id),
        "replies": str(servo.replies),
        "retries": str(servo.retries),
        "timeouts": str(servo.timeouts),
        "corrupt replies": str(servo.corrupt),
    }
    if state is None:
        level = DiagnosticStatus.ERROR if servo.lost else DiagnosticStatus.STALE
        message = "lost: it does not answer" if servo.lost else "no answer in the last cycle"
        return _entry(name, level, message, counters, str(servo.id))
    values = {
        "position (rad)": f"{state.position:.4f}",
        "velocity (rad/s)": f"{state.velocity:.3f}",
        "load (share of full torque)": f"{state.load:.2f}",
        "voltage (V)": f"{state.voltage:.1f}",
        "temperature (degrees Celsius)": f"{state.temperature:.0f}",
        "torque": "on" if state.torque else "off",
    }
    if state.error:
        level, message = DiagnosticStatus.ERROR, describe_errors(state.error)
    else:
        level, message = DiagnosticStatus.OK, "torque on" if state.torque else "relaxed"
    return _entry(name, level, message, counters | values, str(servo.id))


def _entry(
    name: str, level: bytes, message: str, values: Mapping[str, str], hardware_id: str
) -> DiagnosticStatus:
    return DiagnosticStatus(
        name=name,
        level=level,
        message=message,
        hardware_id=hardware_id,
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )
