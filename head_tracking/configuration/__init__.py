"""Parameter files without ROS: the buses and heads that they describe."""

from head_tracking.configuration.heads import (
    ConfiguredBus,
    ConfiguredHead,
    configured_buses,
    configured_head,
    head_parameters,
)

__all__ = [
    "ConfiguredBus",
    "ConfiguredHead",
    "configured_buses",
    "configured_head",
    "head_parameters",
]
