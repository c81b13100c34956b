"""The program head_tracking: the supervisor of a run; see head_tracking.run."""

from __future__ import annotations

import os
import sys

from head_tracking.exceptions import HeadTrackingError
from head_tracking.output import output_may_get_lost
from head_tracking.programs import NO_ROS, has_ros, head_tracking
from head_tracking.ros.kit.stop_signal import EndRequestedError
from head_tracking.run.options import parse_arguments
from head_tracking.run.status_line import StatusLine
from head_tracking.run.supervisor import Supervisor

_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"


def main() -> int:
    """Run the head until a signal; return the exit code."""
    with output_may_get_lost():
        plan = parse_arguments(sys.argv[1:])
        # A colleague's head is not this run's to turn, and ROS's own setup.bash says SUBNET.
        if plan.keeps_to_itself and os.environ.get(_RANGE, "SUBNET") in ("", "SUBNET"):
            os.environ[_RANGE] = "LOCALHOST"
        StatusLine().prepare_logging()
        try:
            if not has_ros():
                raise HeadTrackingError(NO_ROS)
            return Supervisor(plan).run()
        except EndRequestedError:
            return 0
        except HeadTrackingError as error:
            print(f"head_tracking: {error}", file=sys.stderr)
            return 1


if __name__ == "__main__":
    raise SystemExit(head_tracking())
