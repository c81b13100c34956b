"""The program head_tracking: starts the supervisor of a run."""

from __future__ import annotations

import os
import sys

from head_tracking.exceptions import HeadTrackingError
from head_tracking.programs import NO_ROS, has_ros
from head_tracking.ros.kit.stop_signal import EndRequestedError
from head_tracking.run.options import parse_arguments
from head_tracking.run.status_line import StatusLine
from head_tracking.run.supervisor import Supervisor

_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"


def main() -> int:
    """Run the head until a signal; return the exit code."""
    plan = parse_arguments(sys.argv[1:])
    # ROS's setup.bash sets SUBNET, so SUBNET is no choice of the user.
    if plan.is_local and os.environ.get(_RANGE, "SUBNET") in ("", "SUBNET"):
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
