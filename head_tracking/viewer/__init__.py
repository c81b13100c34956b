"""The robot in a browser: a page that shows it in 3D and steers it. Knows viser, not ROS."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Final

MISSING: Final = (
    "the viewer needs viser and mcap-ros2-support, which are not installed here: "
    "`ros2 run head_tracking head_setup viewer` in a workspace, "
    "pip install 'head_tracking[viewer]' elsewhere"
)


def installed() -> bool:
    """Return whether the libraries that only the viewer needs are there."""
    return all(find_spec(name) is not None for name in ("viser", "mcap_ros2"))
