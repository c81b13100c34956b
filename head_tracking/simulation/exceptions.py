"""What the simulator can raise; `SimulationError` is the root.

Nothing here is ever raised by bytes from the wire: those are answered or ignored, as real servos
do.
"""

from __future__ import annotations

from head_tracking.exceptions import HeadTrackingError


class SimulationError(HeadTrackingError):
    """Root of the simulator's errors: it was set up or used in a wrong way."""


class UnknownServoError(SimulationError):
    """There is no simulated servo with that id."""


class PortLinkError(SimulationError):
    """The link to the simulated port cannot be made."""
