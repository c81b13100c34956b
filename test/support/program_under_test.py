"""A program of the package, as a person starts and stops it."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

from robot_under_test import wait_for

PATIENCE = 30
MODULES = {
    "head_tracking": "head_tracking",
    "simulated_bus": "head_tracking.tools.simulated_bus",
    "servo_bus": "head_tracking.nodes.servo_bus",
    "relax": "head_tracking.tools.relax",
    "robot_state_publisher": "head_tracking.nodes.robot_state_publisher",
    "joint_state_publisher": "head_tracking.nodes.joint_state_publisher",
    "point_head": "head_tracking.nodes.point_head",
    "recorder": "head_tracking.nodes.recorder",
    "head_tracker": "head_tracking.nodes.head_tracker",
    "fictitious_target": "head_tracking.nodes.fictitious_target",
    "transforms": "head_tracking.tools.transforms",
    "frame_target": "head_tracking.nodes.frame_target",
    "target_mux": "head_tracking.nodes.target_mux",
    "look": "head_tracking.tools.look",
    "visual_target": "head_tracking.nodes.visual_target",
    "detection_target": "head_tracking.nodes.detection_target",
    "simulated_camera": "head_tracking.nodes.simulated_camera",
    "viewer": "head_tracking.nodes.viewer",
}


class Program:
    """
    Args:
        name: one of `MODULES`.
        arguments: of its command line.
        domain: of ROS.
        own_group: it gets a process group of its own.
        environment: over this process's and the defaults; None: without the variable.
        stdout: where its output goes; None: to `output`.
    """

    def __init__(
        self,
        name: str,
        *arguments: str,
        domain: str,
        own_group: bool = False,
        environment: dict[str, str | None] | None = None,
        stdout: Any = None,
    ) -> None:
        given = os.environ | {
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_DOMAIN_ID": domain,
            "PYTHONPATH": os.pathsep.join(
                [str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
            ),
        }
        given |= environment or {}
        self.process = subprocess.Popen(
            # nohup, and a shell's &, have signals ignored
            ["env", "--default-signal", sys.executable, "-u", "-m", MODULES[name], *arguments],
            stdout=subprocess.PIPE if stdout is None else stdout,
            stderr=subprocess.STDOUT,
            text=True,
            env={name: value for name, value in given.items() if value is not None},
            start_new_session=own_group,
        )
        self.output = ""
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        for line in self.process.stdout or ():
            self.output += line

    def read_until(self, words: str) -> str:
        """The line with these words, as soon as it is printed."""

        def found() -> str:
            lines = [line for line in self.output.splitlines() if words in line]
            ended = self.process.poll() is not None
            assert lines or not ended, f"ended without {words!r}:\n{self.output}"
            return lines[0] if lines else ""

        try:
            return wait_for(found, PATIENCE)
        except AssertionError as error:
            raise AssertionError(f"{error}\n{self.output}") from None

    def end(self, number: signal.Signals | None = None) -> int:
        """The exit code, after a signal or by itself."""
        if number is not None:
            self.process.send_signal(number)
        code = self.process.wait(PATIENCE)
        self._reader.join()
        return code

    def kill(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self._reader.join()
        if self.process.stdout is not None:
            self.process.stdout.close()
