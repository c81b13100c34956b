"""Keeps a STOP over a restart."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.logging import get_logger

from head_tracking.control import JointOwners
from head_tracking.ros.kit.head_lock import domain_and_namespace
from head_tracking.share import state_folder


class KeptStop:
    """Keeps the STOP of a real head in a file until `resume` or `forget`.

    Args:
        arguments: of ROS; they may set the namespace.
    """

    def __init__(self, arguments: Sequence[str]) -> None:
        self._file = state_folder("stopped") / f"domain_{domain_and_namespace(arguments)}"

    def guard(self, owners: JointOwners) -> None:
        """Stop the head if it was stopped before and not resumed; keep each STOP from now on."""
        if self._file.exists():
            get_logger("head_tracking").warning(
                "the head was stopped before and not resumed: it is still stopped; call resume"
            )
            owners.stop(dict)
        owners.observe(lambda: self._keep(owners.stopped))

    def forget(self) -> None:
        """Discard the STOP, because the run has ended normally."""
        self._keep(False)

    def _keep(self, stopped: bool) -> None:
        try:
            if stopped:
                self._file.parent.mkdir(parents=True, exist_ok=True)
                self._file.touch()
            else:
                self._file.unlink(missing_ok=True)
        except OSError as error:
            get_logger("head_tracking").warning(f"the STOP cannot be kept over a crash: {error}")
