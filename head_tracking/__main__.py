"""The program head_tracking; see head_tracking.run."""

from __future__ import annotations

import gc
import sys

from head_tracking.output import output_may_get_lost
from head_tracking.ros.stop_signal import StopSignal


def main() -> int:
    """Runs the head until Ctrl-C; returns the exit code."""
    with output_may_get_lost(), StopSignal() as stop:
        with stop.while_importing():
            from head_tracking.run.control import main as run_head

        code = run_head(sys.argv[1:], stop)
    gc.freeze()  # or Python looks through all that is left once more: 0.1 s of processor time
    return code


if __name__ == "__main__":
    raise SystemExit(main())
