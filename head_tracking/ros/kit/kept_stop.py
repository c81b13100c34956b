"""Keeps a STOP while a head starts again."""

from __future__ import annotations

import os
from collections.abc import Sequence

from rclpy.logging import get_logger

from head_tracking.control import JointOwners
from head_tracking.ros.kit.head_lock import namespace
from head_tracking.share import state_folder


class KeptStop:
    """A STOP of a real head, kept in a file until `resume`, or until `forget`.

    Args:
        arguments: of ROS, with the namespace among them.
    """

    def __init__(self, arguments: Sequence[str]) -> None:
        domain = os.environ.get("ROS_DOMAIN_ID") or "0"
        name = f"domain_{domain}{namespace(arguments).rstrip('/').replace('/', '.')}"
        self._file = state_folder("stopped") / name

    def guard(self, owners: JointOwners) -> None:
        """Stop a head that was stopped before, and not resumed; keep each STOP from now on."""
        if self._file.exists():
            get_logger("head_tracking").warning(
                "the head was stopped before, and nobody has called resume: it is stopped still"
            )
            owners.stop(dict)
        owners.observe(lambda: self._keep(owners.stopped))

    def forget(self) -> None:
        """Forget it, for the run has ended orderly."""
        self._keep(False)

    def _keep(self, stopped: bool) -> None:
        try:
            if stopped:
                self._file.parent.mkdir(parents=True, exist_ok=True)
                self._file.touch()
            else:
                self._file.unlink(missing_ok=True)
        except OSError as error:
            get_logger("head_tracking").warning(f"a crash would end the STOP: {error}")
