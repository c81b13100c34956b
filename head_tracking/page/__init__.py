"""The page of one robot in a browser: a server, its live data, and its JavaScript."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Final

MISSING: Final = (
    "The page needs NiceGUI and mcap-ros2-support, which are not installed here: run "
    "`ros2 run head_tracking head_setup viewer` in a workspace, or "
    "pip install 'head_tracking[page]' elsewhere."
)


def installed() -> bool:
    """Return whether the libraries that only the page needs are installed."""
    return all(find_spec(name) is not None for name in ("nicegui", "mcap_ros2"))
