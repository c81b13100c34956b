"""The program head_tracking; see head_tracking.runner."""

from __future__ import annotations

import sys

from head_tracking.output import output_may_get_lost
from head_tracking.ros.stop_signal import StopSignal


def main() -> int:
    """Runs the head until Ctrl-C; returns the exit code."""
    with output_may_get_lost(), StopSignal() as stop:
        # ROS takes a while to import, and Ctrl-C is heard from the first moment on
        from head_tracking.runner import main as run_head

        return run_head(sys.argv[1:], stop)


if __name__ == "__main__":
    raise SystemExit(main())
