"""Errors of the simulator. Bytes from the wire never raise one: servos answer or ignore them."""

from __future__ import annotations

from head_tracking.exceptions import HeadTrackingError


class SimulationError(HeadTrackingError):
    """The simulator was set up or used in a wrong way; root of its errors."""
