"""What the head tracker says on /diagnostics."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from head_tracking.tracking import Delays


def tracker_diagnostics(state: str, law: str, delays: Delays) -> DiagnosticArray:
    """One entry: what the head does, by which law, and how late everything is."""
    pan, tilt = delays.servos
    rate = f"{1.0 / delays.interval:.1f}" if delays.interval > 0.0 else "-"
    values = {
        "law": law,
        "targets per second": rate,
        "age of a target (ms)": f"{1e3 * delays.message:.1f}",
        "age of the joint states (ms)": f"{1e3 * delays.reading:.1f}",
        "pan servo's delay (ms)": f"{1e3 * pan:.1f}",
        "tilt servo's delay (ms)": f"{1e3 * tilt:.1f}",
    }
    status = DiagnosticStatus(
        name="head_tracker: target",
        level=DiagnosticStatus.OK,
        message=state,
        hardware_id="head",
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )
    return DiagnosticArray(status=[status])
